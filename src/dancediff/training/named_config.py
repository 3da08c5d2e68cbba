"""Configs that come with dancediff, by their names."""

from pathlib import Path

_PLACES = (  # in a wheel; in a checkout
    Path(__file__).parents[1] / "configs",
    Path(__file__).parents[3] / "configs",
)


def packaged_configs() -> dict[str, Path]:
    """The files of the configs that come with dancediff, by name.

    >>> "tcdiffpp_small" in packaged_configs()
    True
    """
    folder = next((place for place in _PLACES if place.is_dir()), None)
    return {} if folder is None else {path.stem: path for path in sorted(folder.glob("*.toml"))}


def config_file(config) -> Path:
    """The file of a config: a path as it is, or the name of one that comes with dancediff.

    Raises: ValueError naming the packaged ones when it is neither.

    >>> config_file("tcdiffpp_small").name
    'tcdiffpp_small.toml'
    """
    path, known = Path(config), packaged_configs()
    if path.exists() and not path.is_dir():
        return path
    if str(path) in known:
        return known[str(path)]
    folder = next(iter(known.values())).parent if known else "configs/"
    raise ValueError(
        f"config {str(path)!r} does not exist; dancediff comes with {', '.join(known) or 'none'}, "
        f"in {folder}"
    )
