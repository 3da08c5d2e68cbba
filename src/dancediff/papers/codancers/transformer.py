r"""The transformer that chooses the next units of a group's dancers.

Symbols (axes: b batch · n dancers · u units · l = n u tokens · m music features of a unit
         k codes · d channels · p parts of a dancer)
    codes    units of upper half, lower half and root, times 0 .. u-1   (b, n, 3, u)
    places   of the root at the end of each unit, normalised            (b, n, u, 3)
    M        music of times 1 .. u: that of the unit to be chosen       (b, u, m)
    logits   of the units of times 1 .. u                               (b, n, 3, u, k)
"""

from typing import Any

import torch
from einops import rearrange
from torch import Tensor, nn

from dancediff.nn.encoder_layer import EncoderLayer, causal_mask

PARTS = 3  # upper half, lower half, root


def group_mask(n: int, u: int, *, joint: bool, device=None) -> Tensor:
    """Which tokens of [dancer 0, dancer 1, ...] see which: times up to their own.

    Dancers see those before them, in turn, or with ``joint`` all others: (n u, n u).

    >>> group_mask(2, 1, joint=False).int().tolist()
    [[1, 0], [1, 1]]
    """
    times = causal_mask(u, device)
    dancers = torch.ones_like(causal_mask(n, device)) if joint else causal_mask(n, device)
    return (dancers[:, None, :, None] & times[None, :, None, :]).reshape(n * u, n * u)


class GroupTransformer(nn.Module):
    """Layers for each dancer alone, then for the group; the music joins at the end.

    Source: CoDancers' code.  Differs: the layers for the group see dancers. The released ones are
    given [clip and time, dancer] without being told which axis is which, so they mix clips and
    later times, and dancers are independent but for their start.

    Shapes: see the module's symbols.
    Raises: ValueError for more dancers or times than there are places for.

    >>> sizes = {"num_layers": 1, "group_layers": 1, "music_layers": 1, "num_heads": 2}
    >>> sizes |= {"num_codes": 8, "length": 6, "dancers": 5, "music_dim": 9, "ff_dim": 32}
    >>> net = GroupTransformer(16, **sizes)
    >>> codes, places = torch.zeros(2, 3, 3, 4, dtype=torch.long), torch.zeros(2, 3, 4, 3)
    >>> net(codes, places, torch.randn(2, 4, 9)).shape
    torch.Size([2, 3, 3, 4, 8])
    """

    def __init__(
        self,
        d_model: int,
        *,
        num_codes: int,
        length: int,
        dancers: int,
        music_dim: int,
        num_layers: int,
        group_layers: int,
        music_layers: int,
        joint: bool = False,
        **layer: Any,
    ):
        """``layer``: see `dancediff.nn.encoder_layer.EncoderLayer`."""
        super().__init__()
        self.length, self.dancers, self.joint = length, dancers, joint
        self.embed = nn.ModuleList(nn.Embedding(num_codes, d_model) for _ in range(PARTS))
        self.place = nn.Sequential(nn.Linear(3, 128), nn.ReLU(), nn.Linear(128, d_model))
        self.music = nn.Linear(music_dim, d_model)
        self.times = nn.Parameter(0.02 * torch.randn(length, d_model))
        self.slots = nn.Parameter(0.02 * torch.randn(dancers, 1, d_model))
        self.alone, self.group, self.heard = (
            nn.ModuleList(EncoderLayer(d_model, **layer) for _ in range(count))
            for count in (num_layers, group_layers, music_layers)
        )
        self.norm = nn.LayerNorm(d_model)
        self.out = nn.Sequential(
            nn.Linear(d_model, d_model), nn.GELU(), nn.Linear(d_model, PARTS * num_codes)
        )

    def forward(self, codes: Tensor, places: Tensor, M: Tensor) -> Tensor:
        """Logits of the units that come next."""
        b, n, _, u = codes.shape
        if n > self.dancers or u > self.length or M.shape[1] != u:
            raise ValueError(
                f"codes are of {n} dancers and {u} times, the music of {M.shape[1]}; expected at "
                f"most {self.dancers} dancers, and as many times, at most {self.length}"
            )
        times, mask = self.times[:u], causal_mask(u, codes.device)
        poses = sum(embed(codes[:, :, k]) for k, embed in enumerate(self.embed))
        h = poses + self.place(places) + times + self.slots[:n]
        h = run(self.alone, h.flatten(0, 1), mask).unflatten(0, (b, n))
        among = group_mask(n, u, joint=self.joint, device=codes.device)
        h = run(self.group, h.flatten(1, 2), among).unflatten(1, (n, u))
        h = h + run(self.heard, self.music(M) + times, mask)[:, None]
        return rearrange(self.out(self.norm(h)).float(), "b n u (p k) -> b n p u k", p=PARTS)


def run(layers: nn.ModuleList, h: Tensor, mask: Tensor) -> Tensor:
    """All layers under one mask.

    >>> run(nn.ModuleList(), torch.ones(1), torch.ones(1)).item()
    1.0
    """
    for layer in layers:
        h = layer(h, mask)
    return h
