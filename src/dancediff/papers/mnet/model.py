r"""MNET: a dance in a genre, one second after the other, learned from a critic.

Read first: generator.py and critic.py in this folder · Kim et al. 2022.

Symbols (axes: b batch · n dancers · s frames of motion seen · w frames of music · k frames guessed
         d motion, m music features · g genres)
    history   motion, normalised                                            (b, s, d)
    M         music from the first frame of the history on, standardised    (b, w, m)
    z         noise: the same genre, danced by another                      (b, z)
    style     the style token                                               (b, d_model)
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
from torch import Tensor

from dancediff.autoregression.network import (
    AutoregressiveNetwork,
    check_seen,
    check_targets,
    moved_to_origin,
)
from dancediff.autoregression.roll_out import roll_out
from dancediff.data.windows import Batch
from dancediff.genre import GENRES
from dancediff.motion.representation import TCDIFFPP, joints_of
from dancediff.nn.frozen import frozen
from dancediff.nn.losses import mean, with_total
from dancediff.nn.mapping_network import MappingNetwork
from dancediff.papers.mnet.critic import (
    GenreCritic,
    diversity,
    hinge,
    style_consistency,
)
from dancediff.papers.mnet.generator import Generator

WEIGHTS = {  # MNET's code
    "future": 1.0,
    "joints": 1.0,
    "adversarial": 1.0,
    "consistency": 1.0,
    "critic": 1.0,
}


@dataclass(frozen=True)
class MNETConfig:
    """Sizes; plain values, so that it can be stored as JSON. The defaults are for a laptop.

    >>> MNETConfig.paper().num_frames, MNETConfig().num_frames
    (120, 60)
    """

    d_model: int = 128  # width of a token
    num_heads: int = 4  # of attention
    num_layers: int = 4  # layers of the transformer
    critic_layers: int = 2  # layers of the critic
    critic_hidden: int = 64  # width of the critic's heads
    ff_dim: int = 512  # width inside a feed-forward block
    noise: int = 64  # numbers of the noise
    seed_frames: int = 30  # of motion that it sees
    music_frames: int = 60  # frames of music that it sees
    targets: int = 15  # frames that it guesses, all of which are kept
    diversity: float = 0.5  # weight of the diversity loss
    max_dancers: int = 10  # who find a place on the stage; the network knows one
    motion_dim: int = 151  # features of a dancer's frame
    music_dim: int = 35  # features of a frame of music
    genres: tuple[str, ...] = GENRES  # names in the order of their numbers

    @classmethod
    def paper(cls, **changes) -> "MNETConfig":
        """Sizes of the released MNET, and 10 genres, as many as it has."""
        sizes: dict[str, Any] = {"d_model": 768, "num_heads": 12, "num_layers": 8, "noise": 256}
        sizes |= {"critic_layers": 4, "ff_dim": 2048, "genres": GENRES[:10]}
        sizes |= {"seed_frames": 60, "music_frames": 120, "targets": 30}
        return cls(**sizes | changes)

    @property
    def num_frames(self) -> int:
        """Length of a window to learn from."""
        return max(self.music_frames, self.seed_frames + self.targets)


class _Examples(NamedTuple):
    """What a step of training learns from."""

    history: Tensor
    later: Tensor  # (b, k, d)
    M: Tensor
    genre: Tensor  # (b,)


class MNET(AutoregressiveNetwork):
    r"""A generator with a style, a critic with a verdict for each genre.

    $$\hat x_{s+1} \dots \hat x_{s+k} = G(x_1 \dots x_s,\ M_1 \dots M_w,\ \text{map}_g(z))$$

    Source: Kim et al. 2022; sizes of the released code.  Differs: joints by forward kinematics
    instead of the vertices of SMPL, which the code compares without a gradient; places are seen
    from the last frame of the history; generator and critic learn in the same step; those of one
    `StyledLayer`, `GenreCritic`, `style_consistency` and `diversity`.

    Shapes: history (b, s, d), M (b, w, m), style (b, d_model) -> (b, k, d).
    Raises: ValueError naming the argument whose shape does not fit.

    >>> model = MNET(MNETConfig(d_model=16, num_heads=2, num_layers=1, ff_dim=32))
    >>> style = model.style(torch.tensor([0, 3]), torch.randn(2, 64))
    >>> model(torch.randn(2, 30, 151), torch.randn(2, 60, 35), style).shape
    torch.Size([2, 15, 151])
    """

    stages = ("train",)
    config: MNETConfig

    def __init__(self, config: MNETConfig | None = None):
        """Random weights; normalisers that change nothing until training fits them."""
        c = config or MNETConfig()
        check_targets(c)
        super().__init__(c.motion_dim, c.music_dim)
        self.config = c
        sizes: dict[str, Any] = {"motion_dim": c.motion_dim, "music_dim": c.music_dim}
        sizes |= {"num_heads": c.num_heads, "ff_dim": c.ff_dim}
        self.mapping = MappingNetwork(c.noise, c.d_model, len(c.genres))
        self.generator = Generator(
            c.d_model,
            seed_frames=c.seed_frames,
            music_frames=c.music_frames,
            targets=c.targets,
            num_layers=c.num_layers,
            **sizes,
        )
        self.critic = GenreCritic(
            c.d_model,
            tokens=c.seed_frames + c.targets + c.music_frames,
            num_layers=c.critic_layers,
            hidden=c.critic_hidden,
            genres=len(c.genres),
            **sizes,
        )

    def style(self, genre: Tensor, z: Tensor) -> Tensor:
        """The style token of a genre (b,) and noise (b, z)."""
        return self.mapping.of_genre(z, genre)

    def forward(self, history: Tensor, M: Tensor, style: Tensor) -> Tensor:
        """See the equation."""
        check_seen(history, M, self.config)
        guess = self.generator(moved_to_origin(history, at=-1), M, style)
        guess[..., TCDIFFPP.floor] += history[:, -1:, TCDIFFPP.floor]
        return guess

    def losses(self, batch: Batch, stage: str, generator: torch.Generator) -> dict[str, Tensor]:
        """Those of generator and critic, of windows whose genre is known.

        Raises: ValueError when there is none.
        """
        one = self.examples(batch)
        b, c = len(one.genre), self.config
        device = one.history.device
        z_1, z_2 = torch.randn(2, b, c.noise, generator=generator).to(device)
        step = torch.randint(1, max(2, len(c.genres)), (b,), generator=generator).to(device)
        other = (one.genre + step) % len(c.genres)
        made = self(one.history, one.M, self.style(one.genre, z_1))
        again = self(one.history, one.M, self.style(one.genre, z_2))
        made_as_other = self(one.history, one.M, self.style(other, z_1))  # in another genre
        with frozen(self.critic):
            score_made = self.score(one, made, one.genre)
            as_asked, as_true = (self.score(one, made_as_other, g) for g in (other, one.genre))
        real = self.score(one, one.later, one.genre)
        fake = self.score(one, made.detach(), one.genre)
        terms = {
            "future": mean((made - one.later).square()),
            "joints": mean((self.joints(made) - self.joints(one.later)).square()),
            "adversarial": -mean(score_made),
            "consistency": style_consistency(as_asked, as_true),
            "diversity": diversity(z_1, z_2, made, again),
            "critic": hinge(real, fake),
        }
        return with_total(terms, WEIGHTS | {"diversity": c.diversity})

    def examples(self, batch: Batch) -> _Examples:
        """Histories, what comes after them, music and genres of the windows."""
        c, n = self.config, batch.x.shape[1]
        if batch.genre is None or not batch.genre.any():
            raise ValueError(
                "no window has one of the genres; learn from takes whose genre is known"
            )
        rows = batch.genre.sum(-1) > 0
        x, M = batch.x[rows].flatten(0, 1), batch.M[rows].repeat_interleave(n, 0)
        genre = batch.genre[rows].argmax(-1).repeat_interleave(n)
        later = x[:, c.seed_frames :][:, : c.targets]
        return _Examples(x[:, : c.seed_frames], later, M[:, : c.music_frames], genre)

    def score(self, one: _Examples, later: Tensor, genre: Tensor) -> Tensor:
        """What the critic says of the frames after the history."""
        x = torch.cat([one.history, later], dim=1)
        return self.critic(moved_to_origin(x, at=self.config.seed_frames - 1), one.M, genre)

    def joints(self, x: Tensor) -> Tensor:
        """Places of joints, metres."""
        return joints_of(self.normalizer.unnormalize(x))

    @property
    def history_frames(self) -> int:
        """``seed_frames``: one second by default, two in `MNETConfig.paper`."""
        return self.config.seed_frames

    def dance(
        self, history: Tensor, M: Tensor, request: Any, generators: Sequence[torch.Generator]
    ) -> Iterator[Tensor]:
        """Roll out, all frames of each guess; the noise of a dancer is drawn once.

        Source: MNET's code.  Differs: a mix of genres is that of their style tokens.
        """
        c = self.config
        z = torch.stack([torch.randn(c.noise, generator=g) for g in generators]).to(history.device)
        shares = torch.tensor(request.genre_shares(c.genres)).to(z)
        style = torch.einsum("g,bgd->bd", shares, self.mapping(z))

        def step(history: Tensor, music: Tensor) -> Tensor:
            return self(history, music, style)

        how = {"frames": request.frames, "keep": c.targets, "window": c.music_frames}
        yield from roll_out(step, history, M, **how)  # what is above waits for the first frame
