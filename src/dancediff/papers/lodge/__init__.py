"""Lodge: long dances from coarse to fine, component by component."""
