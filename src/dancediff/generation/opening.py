"""The opening of a song, so that a dance can begin before all of the song is known.

Read first: `dancediff.music.song`.
"""

from torch import Tensor

from dancediff.axes import FPS
from dancediff.threads import Worker

MARGIN = 5 * FPS  # frames before the opening's end: beats and chroma need their surroundings
SHORTEST_OPENING = 15.0  # seconds; so much holds a window of 5 s and the margin


class Opening:
    """A song whose first ``seconds`` have features of their own, which are there at once.

    The features of the whole song are made in a thread of their own, once `compute_features` is
    called. Tempo is that of the opening; length and loudness are those of the song.

    Raises: ValueError for less than 15 s.

    >>> import dancediff as dd
    >>> song = Opening(dd.packaged_song(), 20)
    >>> song.features_until(5 * FPS).shape, song.features_until(16 * FPS).shape
    (torch.Size([601, 35]), torch.Size([932, 35]))
    """

    def __init__(self, song, seconds: float):
        """Nothing is computed yet."""
        try:
            enough = seconds >= SHORTEST_OPENING
        except TypeError:  # a text, say
            enough = False
        if not enough:
            raise ValueError(
                f"opening={seconds!r} must be at least {SHORTEST_OPENING:g} s, or None"
            )
        self.song = song
        self._part = song if seconds >= song.duration else song.slice(0, seconds)
        self._thread: Worker | None = None
        self._failed: BaseException | None = None

    @property
    def name(self) -> str:
        """Of the song."""
        return self.song.name

    @property
    def duration(self) -> float:
        """Of the whole song, in seconds."""
        return self.song.duration

    @property
    def is_silent(self) -> bool:
        """Whether there is nothing to dance to in all of the song."""
        return self.song.is_silent

    @property
    def peak(self) -> float:
        """Largest absolute sample of the whole song."""
        return self.song.peak

    @property
    def tempo(self) -> float:
        """Beats per minute of the opening."""
        return self._part.tempo

    def compute_features(self) -> None:
        """Begin to compute the features of the whole song; returns at once."""
        if self._thread is None:
            self._thread = Worker(self._hear).begin()

    @property
    def has_features(self) -> bool:
        """Whether the features of the whole song are there."""
        return self._thread is not None and not self._thread.is_alive()

    def _hear(self) -> None:
        try:
            self.song.features()
        except BaseException as error:  # raised where the features are asked for
            self._failed = error

    def features(self) -> Tensor:
        """Of the whole song, (f, 35); waits until they are there."""
        self.compute_features()
        assert self._thread is not None
        self._thread.join()
        if self._failed is not None:
            raise self._failed
        return self.song.features()

    def features_until(self, frame: int) -> Tensor:
        """The opening's features if they reach beyond that frame, else those of the song."""
        if frame <= self._part.num_frames - MARGIN or self._part is self.song:
            return self._part.features()
        return self.features()
