r"""CoDancers: the next units of all dancers, from music, places and what those before have done.

Read first: `dancediff.nn.motion_units`, transformer.py and choice.py here.

Symbols (axes: b batch · n dancers · f frames · u units of eight frames · d motion features
         m music features)
    x        motion, normalised                             (b, n, f, d)
    codes    units of upper half, lower half and root       (b, n, 3, u)
    places   of the root at the end of each unit            (b, n, u, 3)
    M        music, standardised                            (b, f, m), of a song (f, m)
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, cast

import torch
from torch import Tensor, nn

from dancediff.autoregression.draw import draw
from dancediff.autoregression.network import AutoregressiveNetwork
from dancediff.autoregression.unit_blocks import (
    HISTORY,
    blocks,
    frames_of,
    music_after,
    unit_music,
)
from dancediff.axes import FPS
from dancediff.data.windows import Batch
from dancediff.motion.halves import LOWER, UPPER, assemble, split
from dancediff.motion.order import left_to_right
from dancediff.motion.representation import TCDIFFPP
from dancediff.nn.motion_units import COMMITMENT, FRAMES, REACH, Units, l_motion
from dancediff.papers.codancers.choice import focal_loss, reweighted
from dancediff.papers.codancers.transformer import PARTS, GroupTransformer

FOLLOWED = 0.99  # how slowly the shares of units in training follow a batch


@dataclass(frozen=True)
class CoDancersConfig:
    """Sizes; plain values, so that it can be stored as JSON. The defaults are for a laptop.

    ``joint``: dancers see all others, not only those before them.

    >>> CoDancersConfig.paper().num_codes, CoDancersConfig().num_frames
    (768, 128)
    """

    d_model: int = 128  # width of a token
    num_heads: int = 4  # of attention
    num_layers: int = 3  # of each dancer alone
    group_layers: int = 1  # layers that see other dancers
    music_layers: int = 1  # layers that see music alone
    ff_dim: int = 512  # width inside a feed-forward block
    width: int = 64  # of the convolutions between motion and units
    code_dim: int = 64  # numbers of a code
    num_codes: int = 128  # codes of a codebook
    code_decay: float = 0.9  # of the codebook's moving average
    length: int = 15  # units that the transformer sees, 4 seconds
    joint: bool = False  # dancers see all others, not only those before
    max_dancers: int = 5  # who find a place on the stage
    music_dim: int = 35  # features of a frame of music

    @classmethod
    def paper(cls, **changes) -> "CoDancersConfig":
        """Sizes of the released CoDancers, which has places for 7 dancers."""
        sizes: dict[str, Any] = {"d_model": 768, "num_heads": 12, "ff_dim": 3072, "length": 30}
        sizes |= {"num_layers": 6, "group_layers": 2, "music_layers": 6, "max_dancers": 7}
        sizes |= {"width": 512, "code_dim": 512, "num_codes": 768, "code_decay": 0.99}
        return cls(**sizes | changes)

    @property
    def num_frames(self) -> int:
        """Length of a window to learn from: the first unit is only seen, the last only chosen."""
        return FRAMES * (self.length + 1)


class CoDancers(AutoregressiveNetwork):
    r"""Three vocabularies, and a transformer that chooses the next units of all dancers.

    Two trainings: "units" learns codes and what motion they are, "gpt" which come next.

    Source: CoDancers and its code, whose idea of dancers in turn the code does not carry out, see
    `GroupTransformer`.  Differs: 30 frames a second with units of eight frames; rotations and
    contacts instead of places of joints; the units of one time are drawn together, so that dancers
    see only the past of those before them; 35 features of music; dancers stand from left to right;
    they start where people stand in a row, or from a dance that is given, not from the truth.

    >>> sizes = {"num_layers": 1, "ff_dim": 32, "width": 16, "code_dim": 8}
    >>> model = CoDancers(CoDancersConfig(d_model=16, num_heads=2, **sizes))
    >>> model.codes(torch.randn(2, 3, 128, 151)).shape
    torch.Size([2, 3, 3, 16])
    """

    stages = ("units", "gpt")
    solo = False
    config: CoDancersConfig
    shares: Tensor  # of each unit in training (3, k)

    def __init__(self, config: CoDancersConfig | None = None):
        """Random weights, empty codebooks; normalisers change nothing until training fits them."""
        c = config or CoDancersConfig()
        super().__init__(TCDIFFPP.dim, c.music_dim)
        self.config = c
        book: dict[str, Any] = {"num_codes": c.num_codes, "decay": c.code_decay}
        book |= {"width": c.width, "code_dim": c.code_dim}
        self.units = nn.ModuleList(Units(size, **book) for size in (len(UPPER), len(LOWER), 3))
        self.gpt = GroupTransformer(
            c.d_model,
            num_codes=c.num_codes,
            length=c.length,
            dancers=c.max_dancers,
            music_dim=FRAMES * c.music_dim,
            num_layers=c.num_layers,
            group_layers=c.group_layers,
            music_layers=c.music_layers,
            joint=c.joint,
            num_heads=c.num_heads,
            ff_dim=c.ff_dim,
        )
        self.register_buffer("shares", torch.full((PARTS, c.num_codes), 1 / c.num_codes))

    @property
    def parts(self) -> list[Units]:
        """The vocabularies of upper half, lower half and root."""
        return [cast(Units, units) for units in self.units]

    def codes(self, x: Tensor) -> Tensor:
        """The units of a dance, (b, n, 8 u, d) -> (b, n, 3, u)."""
        parts = zip(self.parts, split(x.flatten(0, 1)), strict=True)
        codes = torch.stack([units.codes(part) for units, part in parts], dim=1)
        return codes.unflatten(0, x.shape[:2])

    def motion(self, codes: Tensor, start: Tensor, part: slice = slice(None)) -> Tensor:
        """The dance of units, from ``start`` (b, n, 2) on; of all units or some of them.

        Shapes: codes (b, n, 3, u) -> (b, n, 8 u, d).
        """
        frames = frames_of(part)
        rows = codes.flatten(0, 1)
        parts = [units.motion(rows[:, k])[:, frames] for k, units in enumerate(self.parts)]
        x = assemble(parts[0], parts[1], parts[2], start.flatten(0, 1))
        return x.unflatten(0, codes.shape[:2])

    def learning(self, stage: str) -> Sequence[nn.Module]:
        """Each training changes its own part."""
        return [self.units] if stage == "units" else [self.gpt]

    def losses(self, batch: Batch, stage: str, generator: torch.Generator) -> dict[str, Tensor]:
        """Those of the stage."""
        if stage == "units":
            return self.unit_losses(batch.x.flatten(0, 1), generator)
        with torch.no_grad():
            codes = self.codes(batch.x)
            if self.training:
                self._count(codes)
        places = batch.x[:, :, FRAMES - 1 :: FRAMES, TCDIFFPP.root]
        M = unit_music(batch.M[:, : self.config.num_frames])
        logits = self.gpt(codes[..., :-1], places[:, :, :-1], M[:, 1:])
        loss = focal_loss(logits, codes[..., 1:])
        return {"next": loss, "total": loss}

    def unit_losses(self, x: Tensor, generator: torch.Generator) -> dict[str, Tensor]:
        """As Bailando's, with units of the root's velocity as well; x (b, f, d)."""
        terms, commitment = {}, []
        names = ("upper", "lower", "root")
        for name, units, part in zip(names, self.parts, split(x), strict=True):
            guess, _, committed = units(part, generator)
            terms[name] = l_motion(guess, part)
            commitment.append(committed)
        terms["commitment"] = torch.stack(commitment).sum()
        plain = terms["upper"] + terms["lower"] + terms["root"]
        return terms | {"total": plain + COMMITMENT * terms["commitment"]}

    @torch.no_grad()
    def _count(self, codes: Tensor) -> None:
        """Let the shares of units follow those of a batch."""
        for k, share in enumerate(self.shares):
            met = torch.bincount(codes[:, :, k].flatten(), minlength=len(share))
            share.lerp_(met / met.sum(), 1 - FOLLOWED)

    @property
    def history_frames(self) -> int:
        """Four units."""
        return FRAMES * HISTORY

    def dance(
        self, history: Tensor, M: Tensor, request: Any, generators: Sequence[torch.Generator]
    ) -> Iterator[Tensor]:
        """Choose units of all dancers, and hand out a block as soon as no later one changes it.

        ``generators``: of each dancer.  Source: CoDancers' code takes the likeliest units.
        """
        x = history[None]
        place, codes = x[:, :, -1, TCDIFFPP.floor], self.codes(x)
        places = x[:, :, FRAMES - 1 :: FRAMES, TCDIFFPP.root]
        for block in blocks(request.frames):
            while codes.shape[-1] < block.near.stop:
                new = self.next_units(codes, places, M, request, generators)
                codes = torch.cat([codes, new], dim=-1)
                places = torch.cat([places, self.next_place(codes, places)], dim=2)
            made = self.motion(codes[..., block.near], place, block.new)
            places = corrected(places, made, block.start)
            place = made[:, :, -1, TCDIFFPP.floor]
            yield made[0]

    def next_units(
        self,
        codes: Tensor,
        places: Tensor,
        M: Tensor,
        request: Any,
        generators: Sequence[torch.Generator],
    ) -> Tensor:
        """The units after ``codes``, of which the first `HISTORY` lie before the song.

        Shapes: codes (1, n, 3, u), places (1, n, u, 3), M (f, m) -> (1, n, 3, 1).
        """
        seen, places = codes[..., -self.config.length :], places[:, :, -self.config.length :]
        order = left_to_right(places[:, :, 0, 0])[0]  # as windows of training are ranked
        music = music_after(M, codes.shape[-1], seen.shape[-1])[None]
        logits = self.gpt(seen[:, order], places[:, order], music)[0, order.argsort(), :, -1]
        p = logits.softmax(-1)
        if request.reweight:
            p = reweighted(p, self.shares, request.reweight)
        how = {"temperature": request.temperature, "top_k": request.top_k}
        drawn = [draw(p[:, k].log(), generators, **how) for k in range(PARTS)]
        return torch.stack(drawn, dim=1)[None, ..., None]

    def next_place(self, codes: Tensor, places: Tensor) -> Tensor:
        """Where the newest unit takes the dancers, as far as units up to it tell; (1, n, 1, 3)."""
        roots = self.parts[2].motion(codes[0, :, 2, -REACH:])[:, -FRAMES:]
        floor = places[0, :, -1, ::2] + roots[..., :2].sum(1) / FPS
        return torch.stack([floor[:, 0], roots[:, -1, 2], floor[:, 1]], dim=-1)[None, :, None]


def corrected(places: Tensor, made: Tensor, done: int) -> Tensor:
    """Places of units that are motion now; those of later units move along.

    They were guessed before the units after them were known, which change the motion a little.

    Shapes: places (b, n, u, 3), made (b, n, 8 k, d), the motion of units from ``done`` on -> like
    places.

    >>> made = torch.zeros(1, 1, 8, 151)
    >>> made[..., 4:7] = torch.tensor([1.0, 0.5, 2.0])
    >>> corrected(torch.zeros(1, 1, 3, 3), made, done=1)[0, 0].tolist()
    [[0.0, 0.0, 0.0], [1.0, 0.5, 2.0], [1.0, 0.0, 2.0]]
    """
    places, true = places.clone(), made[:, :, FRAMES - 1 :: FRAMES, TCDIFFPP.root]
    end = done + true.shape[2]
    places[:, :, end:, ::2] += (true - places[:, :, done:end])[:, :, -1:, ::2]
    places[:, :, done:end] = true
    return places
