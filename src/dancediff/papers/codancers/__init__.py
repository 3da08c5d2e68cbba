"""CoDancers: a group dance as units of single dancers, all of whom choose at once."""
