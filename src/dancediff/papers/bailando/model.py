r"""Bailando: half bodies as units, a transformer that chooses them, an actor and a critic.

Read first: `dancediff.nn.motion_units`, gpt.py and actor_critic.py here · Siyao et al. 2022.

Symbols (axes: b batch · n dancers · f frames · u units of eight frames · d motion features
         m music features)
    x        motion, normalised                    (b, f, d)
    codes    units of the upper and lower half     (b, 2, u)
    M        music, standardised                   (b, f, m), of a song (f, m)
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import torch
import torch.nn.functional as F
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
from dancediff.data.windows import Batch
from dancediff.motion.halves import LOWER, UPPER, assemble, split
from dancediff.motion.representation import TCDIFFPP, joints_of
from dancediff.music.features import BEATS, in_dance_time
from dancediff.nn.losses import mean
from dancediff.nn.motion_units import COMMITMENT, FRAMES, UnitDecoder, Units, l_motion
from dancediff.papers.bailando.actor_critic import (
    Critic,
    actor_critic_losses,
    beat_reward,
    dance_beats,
    has_beat,
)
from dancediff.papers.bailando.gpt import CrossConditionalGPT


@dataclass(frozen=True)
class BailandoConfig:
    """Sizes; plain values, so that it can be stored as JSON. The defaults are for a laptop.

    >>> BailandoConfig.paper().num_codes, BailandoConfig().num_frames
    (512, 128)
    """

    d_model: int = 128  # width of a token
    num_heads: int = 4  # of attention
    num_layers: int = 3  # whose features the critic sees, too
    head_layers: int = 3  # layers behind them
    critic_layers: int = 1  # layers of the critic
    ff_dim: int = 512  # width inside a feed-forward block
    width: int = 64  # of the convolutions between motion and units
    code_dim: int = 64  # numbers of a code
    num_codes: int = 128  # codes of a codebook
    code_decay: float = 0.9  # 300 steps with 0.99 leave few of the codes in use, with 0.9 most
    length: int = 15  # units that the transformer sees, 4 seconds
    dropout: float = 0.0  # share of numbers left out in training
    max_dancers: int = 10  # who find a place on the stage; the network knows one
    music_dim: int = 35  # features of a frame of music

    @classmethod
    def paper(cls, **changes) -> "BailandoConfig":
        """Sizes of the released Bailando."""
        sizes: dict[str, Any] = {
            "d_model": 768,
            "num_heads": 12,
            "num_layers": 6,
            "head_layers": 6,
            "ff_dim": 3072,
        }
        sizes |= {"critic_layers": 3, "width": 512, "code_dim": 512, "num_codes": 512, "length": 29}
        sizes |= {"code_decay": 0.99}
        return cls(**sizes | changes)

    @property
    def num_frames(self) -> int:
        """Length of a window to learn from: the first unit is only seen, the last only chosen."""
        return FRAMES * (self.length + 1)


class Bailando(AutoregressiveNetwork):
    r"""Units of both halves, chosen one after the other from the music, then turned into motion.

    Three trainings: "units" learns codes and what motion they are, "gpt" which one comes next,
    "actor_critic" to meet the beat, on songs of the training set.

    Source: Siyao et al. 2022; sizes of the released code.  Differs: 30 frames a second instead of
    60, so that a unit lasts 0.27 s; rotations and contacts instead of places of joints; music is
    the 35 features of a unit's eight frames side by side instead of 438 at its rate; the decoder of
    the root learns beside the units, without changing them; the first units are those of somebody
    who stands, or of a dance that is given, instead of the truth's; the released code trains its
    actor on the songs of the test set.

    >>> sizes = {"num_layers": 1, "head_layers": 1, "ff_dim": 32, "width": 16, "code_dim": 8}
    >>> model = Bailando(BailandoConfig(d_model=16, num_heads=2, **sizes))
    >>> codes = model.codes(torch.randn(2, 128, 151))
    >>> codes.shape, model.motion(codes, torch.zeros(2, 2)).shape
    (torch.Size([2, 2, 16]), torch.Size([2, 128, 151]))
    """

    stages = ("units", "gpt", "actor_critic")
    config: BailandoConfig

    def __init__(self, config: BailandoConfig | None = None):
        """Random weights, empty codebooks; normalisers change nothing until training fits them."""
        c = config or BailandoConfig()
        super().__init__(TCDIFFPP.dim, c.music_dim)
        self.config = c
        sizes = {"width": c.width, "code_dim": c.code_dim}
        book: dict[str, Any] = {"num_codes": c.num_codes, "decay": c.code_decay}
        self.upper = Units(len(UPPER), **book, **sizes)
        self.lower = Units(len(LOWER), **book, **sizes)
        self.root = UnitDecoder(3, **sizes)
        layer: dict[str, Any] = {"num_heads": c.num_heads, "ff_dim": c.ff_dim, "dropout": c.dropout}
        self.gpt = CrossConditionalGPT(
            c.d_model,
            num_codes=c.num_codes,
            length=c.length,
            music_dim=FRAMES * c.music_dim,
            num_layers=c.num_layers,
            head_layers=c.head_layers,
            **layer,
        )
        self.critic = Critic(c.d_model, num_layers=c.critic_layers, **layer)

    def codes(self, x: Tensor) -> Tensor:
        """The units of a dance, (b, 8 u, d) -> (b, 2, u)."""
        upper, lower, _ = split(x)
        return torch.stack([self.upper.codes(upper), self.lower.codes(lower)], dim=1)

    def motion(self, codes: Tensor, start: Tensor, part: slice = slice(None)) -> Tensor:
        """The dance of units, from ``start`` (b, 2) on; of all units or some of them.

        Shapes: codes (b, 2, u) -> (b, 8 u, d).
        """
        frames = frames_of(part)
        upper, lower = (half.motion(codes[:, k]) for k, half in enumerate((self.upper, self.lower)))
        root = self.root(self.lower.quantizer.e[codes[:, 1]]).float()
        return assemble(upper[:, frames], lower[:, frames], root[:, frames], start)

    def learning(self, stage: str) -> Sequence[nn.Module]:
        """Each training changes its own part."""
        gpt = self.gpt
        parts: dict[str, list[nn.Module]] = {
            "units": [self.upper, self.lower, self.root],
            "gpt": [gpt],
            "actor_critic": [gpt.head, gpt.norm, gpt.out, self.critic],
        }
        return parts[stage]

    def losses(self, batch: Batch, stage: str, generator: torch.Generator) -> dict[str, Tensor]:
        """Those of the stage."""
        n, x = batch.x.shape[1], batch.x.flatten(0, 1)
        if stage == "units":
            return self.unit_losses(x, generator)
        M = batch.M.repeat_interleave(n, 0)[:, : self.config.num_frames]
        later = unit_music(M)[:, 1:]  # of the units to be chosen
        with torch.no_grad():
            codes = self.codes(x)
        if stage == "gpt":
            logits = self.gpt(codes[:, :, :-1], later)
            loss = F.cross_entropy(logits.flatten(0, 2), codes[:, :, 1:].flatten())
            return {"next": loss, "total": loss}
        drawn, r = self.episode(codes[:, :, :1], M, later, generator)
        h = self.gpt.features(drawn[:, :, :-1], later)
        terms = actor_critic_losses(
            self.gpt.choose(h), drawn[:, :, 1:], r, self.critic(h, self.gpt)
        )
        return terms | {"total": terms["actor"] + terms["critic"], "reward": r.mean()}

    def unit_losses(self, x: Tensor, generator: torch.Generator) -> dict[str, Tensor]:
        r"""Motion, and commitment: $L_{upper} + L_{lower} + L_{root} + 0.02\,L_{commitment}$.

        Source: Bailando, pose VQ-VAE; the code's weights.  Shapes: x (b, f, d) -> dict of scalars.
        """
        *halves, root = split(x)
        terms, commitment = {}, []
        for name, units, half in zip(
            ("upper", "lower"), (self.upper, self.lower), halves, strict=True
        ):
            guess, z_q, committed = units(half, generator)
            terms[name] = l_motion(guess, half)
            commitment.append(committed)
        terms["root"] = l_root(self.root(z_q.detach()).float(), root)
        terms["commitment"] = torch.stack(commitment).sum()
        plain = terms["upper"] + terms["lower"] + terms["root"]
        return terms | {"total": plain + COMMITMENT * terms["commitment"]}

    @torch.no_grad()
    def episode(
        self, first: Tensor, M: Tensor, later: Tensor, generator: torch.Generator
    ) -> tuple[Tensor, Tensor]:
        """Units drawn from the policy after the ``first`` one, and the reward of each that is new.

        Shapes: first (b, 2, 1), M (b, f, m), later (b, u - 1, 8 m) -> (b, 2, u), (b, u - 1).
        """
        codes, b = first, len(first)
        for k in range(1, later.shape[1] + 1):
            logits = self.gpt(codes, later[:, :k])[:, :, -1].flatten(0, 1)
            new = draw(logits, [generator] * (2 * b), temperature=1.0, top_k=logits.shape[-1])
            codes = torch.cat([codes, new.reshape(b, 2, 1)], dim=-1)
        x = self.normalizer.unnormalize(self.motion(codes, codes.new_zeros(b, 2).float()))
        dance = has_beat(dance_beats(joints_of(x)).to(x.device))
        music = has_beat(in_dance_time(M[..., BEATS.start]))
        return codes, beat_reward(music, dance)[:, 1:]

    @property
    def history_frames(self) -> int:
        """Four units."""
        return FRAMES * HISTORY

    def dance(
        self, history: Tensor, M: Tensor, request: Any, generators: Sequence[torch.Generator]
    ) -> Iterator[Tensor]:
        """Choose units, and hand out a block as soon as no later unit can change it.

        Source: Bailando, where the most likely unit is taken.
        """
        place, codes = history[:, -1, TCDIFFPP.floor], self.codes(history)
        for block in blocks(request.frames):
            while codes.shape[-1] < block.near.stop:
                codes = torch.cat([codes, self.next_units(codes, M, request, generators)], dim=-1)
            x = self.motion(codes[..., block.near], place, block.new)
            place = x[:, -1, TCDIFFPP.floor]
            yield x

    def next_units(
        self, codes: Tensor, M: Tensor, request: Any, generators: Sequence[torch.Generator]
    ) -> Tensor:
        """The units after ``codes``, of which the first `HISTORY` lie before the song.

        Shapes: codes (n, 2, u), M (f, m) -> (n, 2, 1).
        """
        n, seen = len(codes), codes[:, :, -self.config.length :]
        music = music_after(M, codes.shape[-1], seen.shape[-1]).expand(n, -1, -1)
        logits = self.gpt(seen, music)[:, :, -1]
        how = {"temperature": request.temperature, "top_k": request.top_k}
        halves = [draw(logits[:, k], generators, **how) for k in range(2)]
        return torch.stack(halves, dim=1)[..., None]


def l_root(guess: Tensor, root: Tensor) -> Tensor:
    r"""Velocities and height, and their changes: $\lVert v - \hat v \rVert_1 +
    \lVert v' - \hat v' \rVert_1$.

    Source: Bailando, global velocity.  Shapes: (b, f, 3) -> scalar.

    >>> l_root(torch.ones(1, 8, 3), torch.zeros(1, 8, 3)).item()
    1.0
    """
    error = guess - root
    return mean(error.abs()) + mean(error.diff(dim=-2).abs())
