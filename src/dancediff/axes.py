"""Axis letters, and the one place where dancers and frames become tokens.

Read first: notebook 01. Every shape in this project is written with these letters;
a file that needs another says what it means in the table at its top.

    b batch · n dancers · f frames · d motion features or channels · m music features
    j joints · l tokens · h attention heads · s state of the SSM

`t` is never a frame: it is only ever the noise level. Places are (x, y, z) in metres: x lateral,
y up, z towards the audience; motion and music have `FPS` frames a second.
"""

from einops import rearrange
from torch import Tensor

FPS = 30  # frames a second of every dance and song that a network sees
LATERAL, UP = 0, 1  # of a place (x, y, z)
ON_FLOOR = slice(0, 3, 2)  # x and z of a place; as a list it would wait for a GPU


def to_tokens(x: Tensor) -> Tensor:
    """Line up all dancers of frame 0, then all of frame 1, ... (frame-major).

    Shapes: x (b, n, f, d) -> (b, (f n), d).

    >>> import torch
    >>> x = torch.tensor([[10.0, 11.0], [20.0, 21.0]])[None, :, :, None]  # 2 dancers x 2 frames
    >>> to_tokens(x).flatten().tolist()
    [10.0, 20.0, 11.0, 21.0]
    """
    return rearrange(x, "b n f d -> b (f n) d")


def from_tokens(x: Tensor, n: int) -> Tensor:
    """Undo `to_tokens`.

    Shapes: x (b, l, d) with l = f n -> (b, n, f, d).
    Raises: ValueError when l is no multiple of n.

    >>> import torch
    >>> x = torch.randn(2, 3, 5, 7)
    >>> torch.equal(from_tokens(to_tokens(x), n=3), x)
    True
    """
    if n < 1 or x.shape[1] % n:
        raise ValueError(f"x has {x.shape[1]} tokens, no multiple of n={n}; pass the dancer count")
    return rearrange(x, "b (f n) d -> b n f d", n=n)
