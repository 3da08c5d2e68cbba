r"""The roll-out: a network guesses the next frames, some are kept, and the window moves on.

Symbols (axes: n dancers · s frames that the network sees · k frames that it guesses
         F frames of the song · w frames of music in a window · d motion, m music features)
    history   the last frames of the dance so far        (n, s, d)
    M         music features of the song, standardised   (F, m)
"""

from collections.abc import Callable, Iterator

import torch
from torch import Tensor

Step = Callable[[Tensor, Tensor], Tensor]  # history (n, s, d), music (n, w, m) -> (n, k, d)


def music_window(M: Tensor, start: int, length: int) -> Tensor:
    """Music from frame ``start`` on, which may lie before the song; it repeats without end.

    Shapes: M (F, m) -> (length, m).

    >>> music_window(torch.arange(4.0)[:, None], start=-1, length=6).flatten().tolist()
    [3.0, 0.0, 1.0, 2.0, 3.0, 0.0]
    """
    return M[torch.arange(start, start + length, device=M.device) % len(M)]


def roll_out(
    step: Step, history: Tensor, M: Tensor, *, frames: int, keep: int, window: int
) -> Iterator[Tensor]:
    r"""Frames of a dance as they are made, at least ``frames`` of them, ``keep`` at a time.

    $$x_{f} \dots x_{f + keep - 1} = \text{step}(x_{f-s} \dots x_{f-1},\ M_{f-s} \dots
      M_{f-s+w-1})_{1 \dots keep}$$

    Source: FACT; MNET does the same.  ``window`` is w; the music begins where the
    history does.

    Shapes: history (n, s, d), M (F, m) -> pieces (n, keep, d).
    Raises: ValueError when a guess has fewer frames than are to be kept.

    >>> count = lambda history, music: history[:, -1:] + torch.arange(1.0, 4)[:, None]
    >>> history, M = torch.zeros(1, 5, 1), torch.zeros(9, 1)
    >>> pieces = roll_out(count, history, M, frames=4, keep=2, window=6)
    >>> torch.cat(list(pieces), dim=1).flatten().tolist()
    [1.0, 2.0, 3.0, 4.0]
    """
    n, s, _ = history.shape
    for f in range(0, frames, keep):
        guess = step(history, music_window(M, f - s, window).expand(n, -1, -1))
        if guess.shape[1] < keep:
            raise ValueError(f"keep={keep} is more than the {guess.shape[1]} frames of a guess")
        new = guess[:, :keep]
        history = torch.cat([history, new], dim=1)[:, -s:]
        yield new


def forced_guesses(
    step: Step, x: Tensor, M: Tensor, *, history: int, keep: int, window: int
) -> Tensor:
    """What a network guesses where every history is the truth: no error of before goes on.

    Beside `roll_out` from the first ``history`` frames it shows what a network's own errors do.

    Shapes: x (n, f, d), M (f, m) -> (n, f - history, d), the last guess cut off.

    >>> count = lambda history, music: history[:, -1:] + torch.arange(1.0, 4)[:, None]
    >>> x = torch.tensor([0.0, 0.0, 10.0, 20.0])[None, :, None]
    >>> forced_guesses(count, x, torch.zeros(4, 1), history=2, keep=1, window=3).flatten().tolist()
    [1.0, 11.0]
    """
    n, f, _ = x.shape
    made = []
    for at in range(history, f, keep):
        music = music_window(M, at - history, window).expand(n, -1, -1)
        made.append(step(x[:, at - history : at], music)[:, :keep])
    return torch.cat(made, dim=1)[:, : f - history]
