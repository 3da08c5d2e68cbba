"""Dances as files of other programs, and back: BVH, SMPL arrays, glTF."""
