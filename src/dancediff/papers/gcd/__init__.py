"""GCD: group dance by diffusion and contrast, with a dial from in step to varied."""
