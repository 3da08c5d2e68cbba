"""The tables of a training config that do not depend on the model.

Read first: a file of configs/.

    [data]         what is learned from, and how windows are drawn: `GroupData`
    [model]        ``class`` and sizes
    [train]        `TrainConfig`
    [weights]      of the losses
    [extensions]   what training adds to the papers: `TrainingExtensions`
"""

from dataclasses import dataclass, field

from dancediff.music.features import BLOCKS
from dancediff.nn.losses import TermWeights
from dancediff.own import own_function
from dancediff.papers.tcdiffpp.losses import LossWeights

OPTIMIZERS = ("adamw", "adam", "adan", "muon")
PRECISIONS = ("fp32", "bf16", "fastest")
LARGEST_SEED = 2**40  # the seed of a batch's noise is a million times as large
SHORTEST_SYNTHETIC = 3.0  # seconds in which every synthetic song has the beats a dance needs


@dataclass(frozen=True)
class TrainingExtensions:
    """What training adds to the papers, each off by default; see `dancediff.extensions.registry`.

    Raises: ValueError naming the key, its value and what is allowed.
    """

    metre_unit: bool = False  # a metre is a unit of the floor
    level_weights: float = 0.0  # the power p; 0: all noise levels count the same
    both_guesses: bool = False  # the reconstruction term counts both guesses
    hard_contact: bool = False  # predicted contacts above 0.5 count as 1, others as 0
    joint_velocity_loss: float = 0.0  # weight of a term: joints move as fast as in the dance
    slide_loss: float = 0.0  # weight of a term: feet on the floor do not slide
    own_overlap: float = 0.0  # TCDiff++: share of windows that begin as the network makes them
    music_dropout: float = 0.0  # share of windows without timbre, and of those without harmony
    masked_music: tuple[str, ...] = ()  # blocks of the music features that are always 0
    any_song: float = 0.0  # share of real windows that are danced to another dance's song
    own_loss: str | None = None  # "module:function" of a `Comparison`, one more term
    own_loss_weight: float = 1.0  # of that term

    def __post_init__(self):
        for name in ("level_weights", "any_song", "own_overlap", "music_dropout"):
            _check_share(name, getattr(self, name))
        for name in ("joint_velocity_loss", "slide_loss", "own_loss_weight"):
            _check_least(name, getattr(self, name), 0)
        if self.own_loss is not None:
            own_function(self.own_loss, "own_loss")
        for block in self.masked_music:
            if block not in BLOCKS:
                raise ValueError(f"masked_music: {block!r} is not one of {', '.join(BLOCKS)}")


@dataclass(frozen=True)
class Data:
    """What is learned from: a prepared folder, or choreographed dances to synthetic songs.

    Raises: ValueError naming the key, its value and what is allowed.
    """

    folder: str | None = None  # of prepared takes
    songs: int = 100  # without a folder: how many
    seconds: float = 30.0  # without a folder: length of a dance
    varied: bool = True  # without a folder: songs with intros, breaks and changes, no simple ones
    workers: int = 2  # without a folder: processes that choreograph
    held_out: int = 5  # without a folder: how many more songs to evaluate on
    mirror: float = 0.0  # share of windows mirrored left to right
    music: bool = False  # any of the songs that fit a take's beats
    real: float | None = None  # share of windows that people danced

    def __post_init__(self):
        _check_least("songs", self.songs, 1)
        _check_least("workers", self.workers, 1)
        _check_least("held_out", self.held_out, 1)
        _check_least("seconds", self.seconds, SHORTEST_SYNTHETIC)
        _check_share("mirror", self.mirror)
        _check_share("real", self.real or 0.0)


@dataclass(frozen=True)
class GroupData(Data):
    """For all models but Lodge; see `dancediff.data.windows.WindowSampler`."""

    dancers_per_batch: int = 24  # windows of groups are put together until so many dance
    shift: float = 0.0  # longest way that a window is moved along x and z, metres
    rotate: float = 0.0  # largest turn of a window to either side, radians
    swaps: float = 0.0  # share of windows that show a change of order

    def __post_init__(self):
        super().__post_init__()
        _check_least("dancers_per_batch", self.dancers_per_batch, 1)
        _check_share("swaps", self.swaps)


@dataclass(frozen=True)
class SoloData(Data):
    """For Lodge; see `dancediff.data.windows.WindowSampler`."""

    seconds: float = 40.0  # without a folder: length of a dance
    windows_per_batch: int = 16  # of the local stage
    global_windows_per_batch: int = 16  # of the global stage

    def __post_init__(self):
        super().__post_init__()
        _check_least("windows_per_batch", self.windows_per_batch, 1)
        _check_least("global_windows_per_batch", self.global_windows_per_batch, 1)


@dataclass(frozen=True)
class TrainConfig:
    """Steps, optimiser, schedule, and how often something is written.

    Raises: ValueError naming the key, its value and what is allowed.
    """

    steps: int = 10_000  # updates of the weights
    optimizer: str = "adamw"  # or "adam", "adan", "muon"; see `training.optimizer`
    lr: float = 1e-3  # highest learning rate
    fusion_lr: float = 0.2  # share of lr that the Fusion Projection gets
    warmup: int = 300  # steps until the full learning rate
    decay: float = 0.3  # last share of the run over which the learning rate falls to zero
    weight_decay: float = 0.01  # of the optimiser
    clip: float = 1.0  # longest gradient; 0: any
    ema: float = 0.999  # share of the averaged weights that a step keeps
    precision: str = "fp32"  # or "bf16": the network under autocast; "fastest": one of the two
    accumulate: int = 1  # batches a step and process, whose gradients are averaged
    seed: int = 0  # of weights, windows and noise
    save_every: int = 500  # steps from checkpoint to checkpoint
    evaluate_every: int = 0  # steps from one validation loss to the next; 0: never
    preview_every: int = 0  # steps from one filmstrip to the next; 0: never
    metrics_every: int = 0  # steps from one row of metrics to the next; 0: never
    patience: int = 0  # evaluations without a better loss after which a run ends; 0: any number
    weights: TermWeights = field(default_factory=LossWeights)
    extensions: TrainingExtensions = field(default_factory=TrainingExtensions)

    def __post_init__(self):
        for name, known in (("optimizer", OPTIMIZERS), ("precision", PRECISIONS)):
            if getattr(self, name) not in known:
                words = ", ".join(map(repr, known))
                raise ValueError(f"{name}={getattr(self, name)!r} is not one of {words}")
        for name in ("lr", "fusion_lr"):
            if not 0 < getattr(self, name) < float("inf"):
                raise ValueError(f"{name}={getattr(self, name)} must be above 0")
        for name in ("steps", "save_every", "accumulate"):
            _check_least(name, getattr(self, name), 1)
        every = ("evaluate_every", "preview_every", "metrics_every")
        for name in ("warmup", "weight_decay", "clip", "patience", *every):
            _check_least(name, getattr(self, name), 0)
        if self.patience and not self.evaluate_every:
            raise ValueError(f"patience={self.patience} counts evaluations; set evaluate_every")
        _check_share("decay", self.decay)
        if not 0 <= self.ema < 1:
            raise ValueError(f"ema={self.ema} must lie in 0 ... 1, 1 left out: it is a share kept")
        if not 0 <= self.seed < LARGEST_SEED:
            raise ValueError(f"seed={self.seed} must lie in 0 ... {LARGEST_SEED - 1}")


def _check_least(name: str, value: float, least: float) -> None:
    if not least <= value < float("inf"):
        raise ValueError(f"{name}={value} must be {least:g} or more")


def _check_share(name: str, value: float) -> None:
    if not 0 <= value <= 1:
        raise ValueError(f"{name}={value} must lie in 0 ... 1: it is a share")
