"""The rate at which music is analysed, so that a whole number of samples is one frame of dance."""

from dancediff.axes import FPS

HOP = 512
SAMPLE_RATE = FPS * HOP  # 15,360 Hz makes a hop of 512 samples exactly one frame of 30 fps


def whole_rate(rate) -> int:
    """Samples a second as a whole number, which files and resamplers want.

    Raises: ValueError for another number.

    >>> whole_rate(22050.0)
    22050
    """
    if not (rate > 0 and float(rate).is_integer()):
        raise ValueError(f"rate={rate} must be positive and whole (samples a second)")
    return int(rate)
