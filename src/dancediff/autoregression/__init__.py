"""Dances that are made a few frames at a time, each from the frames before it."""
