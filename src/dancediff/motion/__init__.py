"""Motion: rotations, the joint tree, the `Motion` class and the vectors that networks see."""
