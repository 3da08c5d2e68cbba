"""The learning rate of every step."""

from dancediff.training.config import TrainConfig


def learning_rate(step: int, config: TrainConfig) -> float:
    """Rise, stay, fall: the long flat part lets a run be prolonged from any checkpoint.

    >>> config = TrainConfig(steps=100, lr=1.0, warmup=10, decay=0.5)
    >>> [round(learning_rate(k, config), 2) for k in (0, 9, 49, 75, 99)]
    [0.1, 1.0, 1.0, 0.5, 0.02]
    """
    rise = (step + 1) / config.warmup if config.warmup else 1.0
    fall = (config.steps - step) / max(config.decay * config.steps, 1)
    return config.lr * max(0.0, min(1.0, rise, fall))
