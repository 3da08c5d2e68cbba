"""TCDiff++: group dance by diffusion, component by component."""
