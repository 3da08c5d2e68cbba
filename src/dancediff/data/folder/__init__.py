"""Anybody's motion: what `dancediff prepare folder` reads, finds out, and reports."""
