"""Live dancing: a dance that is shown while it is made, on a page or in a notebook."""
