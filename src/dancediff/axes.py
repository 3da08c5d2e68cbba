"""Axis letters, the frame rate, and which coordinates lie on the floor.

Read first: notebook 01. Every shape in this project is written with these letters;
a file that needs another says what it means in the table at its top.

    b batch · n dancers · f frames · d motion features or channels · m music features
    j joints · l tokens · h attention heads · s state of the SSM

`t` is never a frame: it is only ever the noise level. Places are (x, y, z) in metres: x lateral,
y up, z towards the audience; motion and music have `FPS` frames a second.
"""

FPS = 30  # frames a second of every dance and song that a network sees
LATERAL, UP = 0, 1  # of a place (x, y, z)
ON_FLOOR = slice(0, 3, 2)  # x and z of a place; as a list it would wait for a GPU
