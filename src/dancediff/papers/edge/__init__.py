"""EDGE: diffusion for one dancer and the music, which TCDiff++ and Lodge build on."""
