"""CoDancers: a group dance as units of single dancers, chosen in turn."""
