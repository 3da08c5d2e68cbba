r"""TCDiff: paths of a group first (stage 1), then the bodies on them (stage 2).

Read first: Dai et al. 2025 (TCDiff) section 3 · `dancediff.papers.tcdiff.navigator` ·
`dancediff.papers.tcdiff.trajectory_diffusion`.

Symbols (axes: b batch · n dancers · f frames · F frames of a dance · d motion, m music features)
    x_t, x_hat   noisy motion and the guess, normalised           (b, n, f, d)
    path         places on the floor, normalised x and z          (b, n, f, 2)
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.schedule import Generators
from dancediff.nn.dance_network import DanceNetwork
from dancediff.nn.decoder import check_group, check_shapes
from dancediff.papers.tcdiff.navigator import Navigator, roll_out
from dancediff.papers.tcdiff.path_smoothing import smoothed
from dancediff.papers.tcdiff.start_formations import StartFormations
from dancediff.papers.tcdiff.trajectory_diffusion import TrajectoryDiffusion, on_path


@dataclass(frozen=True)
class TCDiffConfig:
    """Sizes; plain values, so that it can be stored as JSON.

    The defaults are a small model which two CPU cores can train; `paper` has the published sizes.

    >>> TCDiffConfig.paper(max_dancers=4).num_layers
    8
    """

    d_model: int = 128  # width of a token
    num_heads: int = 4  # of attention
    num_layers: int = 4  # of the second stage
    ff_dim: int = 256  # width inside a feed-forward block
    fusion_hidden: int = 256  # width inside the Fusion Projection
    path_width: int = 32  # half of the width of the first stage
    path_layers: int = 3  # of the first stage
    path_music: int = 64  # width inside the first stage's reading of music
    history: int = 100  # frames of a path that the next ones follow from
    stride: int = 25  # frames of a path that are guessed at once
    max_dancers: int = 5  # of a group
    num_frames: int = 150  # of one segment: 5 seconds
    motion_dim: int = 151  # features of a dancer's frame
    music_dim: int = 35  # features of a frame of music
    dropout: float = 0.0  # share of values that are set to zero in training
    cond_drop: float = 0.25  # share of windows in training whose music is masked
    num_steps: int = 1000  # noise levels

    def __post_init__(self):
        """Raises: ValueError unless stride fits into history, and both into a window."""
        if not 1 <= self.stride <= self.history:
            raise ValueError(
                f"stride={self.stride} must lie in 1 ... {self.history}, the frames of history"
            )
        if self.history + self.stride > self.num_frames:
            raise ValueError(
                f"history={self.history} and stride={self.stride} must fit into num_frames="
                f"{self.num_frames}"
            )

    @classmethod
    def paper(cls, **changes) -> "TCDiffConfig":
        """Sizes of TCDiff section 4.1 and its code: 8 layers, 8 heads, width 512."""
        sizes = {"d_model": 512, "num_heads": 8, "num_layers": 8, "ff_dim": 1024}
        sizes |= {"fusion_hidden": 1024, "path_width": 64, "path_layers": 6, "path_music": 438}
        return cls(**sizes | {"dropout": 0.1} | changes)


class TCDiff(DanceNetwork):
    r"""Both stages, normalisers and noise schedule.

    $$\hat x = \text{TSD}([x_t]_{\text{body}} \oplus \text{path},\ t, M) \oplus \text{path}$$

    The path is never noised: it stands in what the network is given, and in what it returns.

    Source: TCDiff section 3.  Differs: both stages are trained at the same time, each by its own
    losses, on true paths; one model serves 1 to ``max_dancers`` dancers, ranked from left to
    right, where the paper trains one for each number.

    Shapes: x_t (b, n, f, d), t (b,), conditions with music and path -> x_hat (b, n, f, d).
    Raises: ValueError naming the argument whose shape does not fit.

    >>> sizes = {"d_model": 16, "num_layers": 1, "ff_dim": 32, "fusion_hidden": 32}
    >>> model = TCDiff(TCDiffConfig(**sizes))
    >>> swap = torch.arange(3).expand(2, 3)
    >>> conditions = model.with_draws(Conditions(torch.randn(2, 150, 35), swap=swap))
    >>> model(torch.randn(2, 3, 150, 151), torch.tensor([10, 900]), conditions).shape
    torch.Size([2, 3, 150, 151])
    """

    config: TCDiffConfig

    def __init__(self, config: TCDiffConfig | None = None):
        """Random weights; normalisers that change nothing until training fits them."""
        c = config or TCDiffConfig()
        super().__init__(c.motion_dim, c.music_dim, c.num_steps)
        self.config = c
        self.start = StartFormations(c.max_dancers)
        self.navigator = Navigator(
            c.music_dim,
            width=c.path_width,
            music_hidden=c.path_music,
            num_layers=c.path_layers,
            num_heads=4,
            dropout=c.dropout,
        )
        self.decoder = TrajectoryDiffusion(c)

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """Guess the clean dance."""
        path = self.check(x_t, t, conditions)
        return on_path(self.decoder(on_path(x_t, path), t, path, conditions), path)

    def denoise(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """The guess, (b, n, f, d)."""
        return self(x_t, t, conditions)

    @torch.no_grad()
    def paths(self, music: Tensor, n: int, generator: Generators = None) -> Tensor:
        """Smoothed paths of n dancers to whole songs: music (b, F, m) -> (b, n, F, 2)."""
        c = self.config
        start = self.start(n, len(music), generator)
        path = roll_out(self.navigator, start, music, history=c.history, stride=c.stride)
        return smoothed(path.transpose(2, 3)).transpose(2, 3)

    @property
    def path_parts(self) -> int:
        """Of a roll-out, until the navigator knows ``history`` frames of it."""
        return -(-self.config.history // self.config.stride) + 1

    def guessed_paths(self, path: Tensor, music: Tensor, part: Tensor) -> tuple[Tensor, Tensor]:
        """The navigator's guess and its target, of true paths: both (b, n, history, 2).

        ``part`` (b,), below `path_parts`: where in a roll-out. 0 is its first guess, from dancers
        who have stood still without music; the last one knows ``history`` frames. Differs: TCDiff
        learns from the latter alone; with ten minutes of training, paths from a standing start then
        ran away.
        """
        h, s = self.config.history, self.config.stride
        path = torch.cat([path[:, :, :1].expand(-1, -1, h, -1), path], dim=2)
        music = torch.cat([music.new_zeros(len(music), h, music.shape[-1]), music], dim=1)
        rows = torch.arange(len(path), device=path.device)[:, None]
        known = (s * part).clamp(max=h)[:, None] + torch.arange(h, device=path.device)  # (b, h)
        (before, heard), (target, later) = (
            (path[rows, :, frames].transpose(1, 2), music[rows, frames])
            for frames in (known, known + s)
        )
        return self.navigator(before, heard, later), target

    def with_draws(self, conditions: Conditions, generator: Generators = None) -> Conditions:
        """The conditions with the navigator's paths, unless they have some."""
        if conditions.path is not None:
            return conditions
        if conditions.swap is None:
            raise ValueError("conditions: swap=None does not tell how many dancers there are")
        n = conditions.swap.shape[1]
        return replace(conditions, path=self.paths(conditions.music, n, generator))

    def check(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """Refuse shapes that do not fit; returns the path."""
        check_group(x_t, self.config)
        (b, n, f, _), c = x_t.shape, self.config
        check_shapes(
            t=(t, (b,)),
            music=(conditions.music, (b, f, c.music_dim)),
            path=(conditions.path, (b, n, f, 2)),
        )
        assert conditions.path is not None  # its shape fits
        return conditions.path
