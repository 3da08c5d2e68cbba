"""What a training needs besides the model and the data: the table ``[train]`` of a config."""

from dataclasses import dataclass, field

from dancediff.papers.tcdiffpp.losses import LossWeights

OPTIMIZERS = ("adamw", "muon", "adan")
PRECISIONS = ("fp32", "bf16")
LARGEST_SEED = 2**40  # the seed of a batch's noise is a million times as large


@dataclass(frozen=True)
class TrainConfig:
    """Steps, optimiser, schedule, and how often something is written.

    Raises: ValueError naming the key, its value and what is allowed.
    """

    steps: int = 10_000
    optimizer: str = "adamw"  # or "muon", or "adan"; see `training.optimizer`
    lr: float = 1e-3
    fusion_lr: float = 0.2  # share of lr that the Fusion Projection gets
    warmup: int = 300  # steps until the full learning rate
    decay: float = 0.3  # last share of the run over which the learning rate falls to zero
    weight_decay: float = 0.01
    clip: float = 1.0  # longest gradient
    ema: float = 0.999
    precision: str = "fp32"  # or "bf16"
    accumulate: int = 1  # batches a step and process, whose gradients are averaged
    seed: int = 0
    save_every: int = 500  # steps
    evaluate_every: int = 0  # steps; 0: never
    evaluate_batches: int = 8  # of the validation split
    preview_every: int = 0  # steps; 0: never
    level_power: float = 0.0  # see `level_weights`; 0: all levels count the same
    weights: LossWeights = field(default_factory=LossWeights)

    @classmethod
    def paper(cls, **changes) -> "TrainConfig":
        """TCDiff++ section 5.1: Adam (no weight decay) at 5e-5; the rest as in its code.

        >>> TrainConfig.paper(steps=100).lr
        5e-05
        """
        paper = {"lr": 5e-5, "fusion_lr": 1.0, "weight_decay": 0.0, "ema": 0.9999}
        return cls(**paper | changes)

    def __post_init__(self):
        for name, known in (("optimizer", OPTIMIZERS), ("precision", PRECISIONS)):
            if getattr(self, name) not in known:
                words = ", ".join(map(repr, known))
                raise ValueError(f"{name}={getattr(self, name)!r} is not one of {words}")
        ranges = {
            "decay": (0 <= self.decay <= 1, "lie in 0 ... 1: it is a share of the run"),
            "ema": (0 <= self.ema < 1, "lie in 0 ... 1, 1 left out: it is a share kept"),
            "level_power": (0 <= self.level_power <= 1, "lie in 0 (off) ... 1"),
            "seed": (0 <= self.seed < LARGEST_SEED, f"lie in 0 ... {LARGEST_SEED - 1}"),
        }
        for name in (
            *("steps", "lr", "fusion_lr", "clip"),
            *("save_every", "accumulate", "evaluate_batches"),
        ):
            ranges[name] = (0 < getattr(self, name) < float("inf"), "be above 0")
        for name in ("warmup", "weight_decay", "evaluate_every", "preview_every"):
            ranges[name] = (0 <= getattr(self, name) < float("inf"), "be 0 or more")
        for name, (fits, allowed) in ranges.items():
            if not fits:
                raise ValueError(f"{name}={getattr(self, name)} must {allowed}")
