"""Dances to learn from: the choreographer, and the windows that a model trains on."""
