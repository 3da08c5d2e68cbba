"""Which sizes a network can have."""

LARGEST, MOST_LAYERS = 8192, 64  # a size beyond is a slip; such a network is never done building


def check_sizes(values: dict, source: str = "") -> None:
    """Refuse whole numbers that no network can have; other values are passed over.

    Raises: ValueError naming the source, the size, its value and what is allowed.

    >>> check_sizes({"num_layers": 1_000_000_000}, "a.toml: 'model'")
    Traceback (most recent call last):
    ValueError: a.toml: 'model': num_layers=1000000000 must lie in 1 ... 64
    """
    for key, value in values.items():
        least = 2 if key == "num_frames" else 1  # motion takes two frames
        most = MOST_LAYERS if key == "num_layers" else LARGEST
        if type(value) is int and not least <= value <= most:
            before = f"{source}: " if source else ""
            raise ValueError(f"{before}{key}={value} must lie in {least} ... {most}")
