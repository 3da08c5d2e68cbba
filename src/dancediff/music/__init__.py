"""Music: loading songs, the 35 features a frame that the networks hear, and synthetic songs."""
