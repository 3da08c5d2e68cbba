"""MNET: a generator of the next second of a dance in a genre, and a critic."""
