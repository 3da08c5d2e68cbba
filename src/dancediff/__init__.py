"""dancediff."""
