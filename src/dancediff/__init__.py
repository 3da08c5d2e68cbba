"""dancediff: diffusion models for dance, to learn, use and extend.

>>> import dancediff as dd
>>> song = dd.packaged_song()
>>> dance = dd.load("tcdiffpp").generate(song, dancers=2, seconds=2, steps=5)
>>> dance.num_dancers, dance.num_frames
(2, 60)
"""

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

# Names are looked up on first use (PEP 562), so that `import dancediff` costs nothing. Those who
# check types read the imports instead.
if TYPE_CHECKING:
    from dancediff.data.choreographer.choreograph import choreograph
    from dancediff.genre import genres
    from dancediff.hub import load, packaged_models, packaged_song
    from dancediff.live_dance.notebook import live
    from dancediff.metrics.report import evaluate
    from dancediff.motion.motion import Motion
    from dancediff.music.song import Music
    from dancediff.user_study.make import study
    from dancediff.viz.learning_curves import learning_curves
    from dancediff.viz.network_picture import network_picture
    from dancediff.viz.stage import play

_HOME = {
    "Music": "dancediff.music.song",
    "Motion": "dancediff.motion.motion",
    "choreograph": "dancediff.data.choreographer.choreograph",
    "evaluate": "dancediff.metrics.report",
    "genres": "dancediff.genre",
    "learning_curves": "dancediff.viz.learning_curves",
    "live": "dancediff.live_dance.notebook",
    "load": "dancediff.hub",
    "network_picture": "dancediff.viz.network_picture",
    "packaged_models": "dancediff.hub",
    "packaged_song": "dancediff.hub",
    "play": "dancediff.viz.stage",
    "study": "dancediff.user_study.make",
}
__all__ = [
    "Motion",
    "Music",
    "__version__",
    "choreograph",
    "evaluate",
    "genres",
    "learning_curves",
    "live",
    "load",
    "network_picture",
    "packaged_models",
    "packaged_song",
    "play",
    "study",
]


def __getattr__(name: str):
    if name not in _HOME:
        raise AttributeError(f"module 'dancediff' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def import_io() -> None:
    """Let `Motion` save, load and draw itself; see `dancediff.motion.files`."""
    import_module("dancediff.io")


def __dir__():
    return sorted(__all__)
