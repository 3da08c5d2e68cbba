"""From a song and a request to a dance."""
