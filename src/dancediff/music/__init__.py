"""Music: loading songs, the 35 features a frame that networks read, and synthetic songs."""
