r"""A dance that is handed out while it is made, and can be steered meanwhile.

Read first: `dancediff.generation.pipeline` · `dancediff.generation.steered_dance`.

    stream = model.stream(song, dancers=3)
    for piece in stream:                      # 2.5 s each
        show(piece, at=stream.begins)
        stream.set(swap=(2, 1, 0))            # from the next segment on
    again = Stream.replay(model, song, stream.log)    # the same dance to the last bit
"""

import contextlib
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from torch import Tensor

from dancediff.axes import FPS
from dancediff.generation.opening import Opening
from dancediff.generation.option import checked
from dancediff.generation.steered_dance import SteeredDance
from dancediff.generation.timing import Timing
from dancediff.motion.motion import Motion
from dancediff.music.live_song import LiveSong
from dancediff.music.song import needed_song

KNOBS = ("genre", "energy", "swap", "formation", "steps", "dancers")


def plain(value: Any) -> Any:
    """A value as JSON can hold it: arrays, tensors and tuples as lists.

    >>> import numpy as np
    >>> plain({"steps": np.int64(6), "start": np.zeros((1, 2)), "swap": (1, 0)})
    {'steps': 6, 'start': [[0.0, 0.0]], 'swap': [1, 0]}
    """
    if isinstance(value, dict):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    return value.tolist() if hasattr(value, "tolist") else value


class _StoppedError(Exception):
    """Leaves a segment that nobody wants any more."""


class Stream(Iterator[Motion]):
    """The pieces of a dance, each as soon as it is ready; `Pipeline.stream` makes it.

    One thread takes the pieces; `set`, `seek` and `stop` may be called by any. What they ask for
    holds from the next segment on. Only TCDiff++ with ``long_sampling="lgds"`` can be steered; the
    others can only be stopped. Lodge hands out a minute at a time, autoregressive models a second,
    the others the whole dance.

    - ``begins``: seconds of the song at which the piece handed out last begins.
    - ``timing``: how long pieces took.
    - ``log``: plain values from which `replay` makes the same dance.

    A piece has its own seams in its ``meta``, and no ``swap``, as a part has that `Motion.frames`
    cuts out; the ``meta`` of the dance so far lies beside them as "whole".
    """

    def __init__(
        self, pipeline, song, options: dict, *, progress=False, opening: float | None = None
    ):
        """Check the options; nothing is danced yet."""
        self._called, song = time.perf_counter(), needed_song(song)
        self._opening = None if opening is None else Opening(song, opening)
        heard = song if self._opening is None else self._opening
        self.pipeline, self.song, self._progress = pipeline, heard, progress
        self.request = pipeline.resolve(heard, **options)
        self._given, self._seconds = options, opening
        self._dance: SteeredDance | None = pipeline.steered(heard, self.request)
        self._check_heard()
        self._made: Iterator[Motion] | None = None
        self._changes: deque[dict] = deque()  # asked for, but not taken up yet
        self._taken: list[dict] = []
        self._script: deque[dict] = deque()  # of a replay
        self._stopped = False
        self._shown = 0.0  # when the first piece was handed out
        self.timing, self.begins, self.danced = Timing(), 0.0, 0.0

    def _check_heard(self) -> None:
        """A dance that is not made segment by segment hears all of the song first."""
        if self._opening is not None and isinstance(self._opening.song, LiveSong):
            raise ValueError(
                f"opening={self._seconds} is for a song that is there; leave it out for a LiveSong"
            )
        if self._dance is None and (self._opening is not None or isinstance(self.song, LiveSong)):
            what = "song is a LiveSong" if self._opening is None else f"opening={self._seconds}"
            raise ValueError(
                f"{what}, but this dance of {self.pipeline.name!r} needs the whole song before its "
                "first step; use a model of tcdiffpp with long_sampling='lgds'"
            )

    def __next__(self) -> Motion:
        """The next piece."""
        if self._script and "stop" in self._script[0] and self._is_due(self._script[0]):
            self.stop()
        begun = time.perf_counter()
        made = self._made  # once: another thread may stop the stream in between
        if made is None:
            if self._stopped or self.is_over:
                raise StopIteration
            made = self._made = self._make()
        try:
            piece = next(made)
        except (StopIteration, _StoppedError):
            self._made = None
            raise StopIteration from None
        now = time.perf_counter()
        if not self.timing.pieces:
            self.timing.first, self._shown = now - self._called, now
            if self._opening is not None:
                self._opening.compute_features()
        self.timing.add(now - begun)
        self.danced += piece.num_frames / FPS
        return piece

    def set(self, **knobs) -> None:
        """Ask for something else from the next segment on.

        - ``genre``, ``energy``: as in `generate`, of models that know them.
        - ``swap``: the dancers from left to right at the end of the next segments; None: any.
        - ``formation``: one (x, z) in metres for each dancer, at the end of the next segments;
          None: anywhere. It goes with no swap: the newer of the two counts.
        - ``steps``: denoising steps; fewer are faster.
        - ``dancers``: so many of those who dance now; the last ones leave, places are given up.

        Raises: ValueError naming the knob, its value and what is allowed.
        """
        unknown = [name for name in knobs if name not in KNOBS]
        if unknown:
            raise ValueError(f"{unknown[0]}= cannot be set while dancing; {', '.join(KNOBS)} can")
        if {"swap", "formation"} <= knobs.keys():
            raise ValueError("set swap= or formation=, not both: places say an order, too")
        dance = self._steered()
        if "dancers" in knobs:
            self._check_leaving(knobs)
        self._resolved(knobs, self._dancers)
        if knobs.get("formation") is not None:
            self._refuse_constraints("formation")
            dance.formation(knobs["formation"], self._dancers)
        if knobs:
            self._changes.append({"set": knobs})

    def _check_leaving(self, knobs: dict) -> None:
        self._refuse_constraints("dancers")
        if knobs.keys() & {"swap", "formation"}:
            raise ValueError("set dancers= alone, and swap= or formation= of those who stay later")
        one = type(self.request).__dataclass_fields__["dancers"]
        if not 1 <= checked(one, knobs["dancers"]) <= self._dancers:
            raise ValueError(
                f"dancers={knobs['dancers']} must lie in 1 ... {self._dancers}: who did not dance "
                "so far cannot join"
            )

    def seek(self, seconds: float) -> None:
        """Go on at another second of the song; the dancers go on from where they are.

        Raises: ValueError for a place outside the dance.
        """
        self._steered()
        self._refuse_constraints("seek")
        try:
            inside = 0 <= seconds < self.request.seconds
        except TypeError:  # a text, say
            inside = False
        if not inside:
            raise ValueError(f"seek({seconds!r}) must lie in 0 ... {self.request.seconds:g} s")
        self._changes.append({"seek": float(seconds)})

    def stop(self) -> None:
        """Hand out no more; a segment that is being made in another thread is left."""
        if not self._stopped:
            self._stopped = True
            self._taken.append({"piece": self.timing.pieces, "stop": True})
        made = self._made  # once: another thread may reach the end in between
        if made is not None:
            with contextlib.suppress(ValueError):  # it runs in another thread, and looks itself
                made.close()  # type: ignore[attr-defined] # a generator
                self._made = None

    close = stop  # as of a generator

    @property
    def is_over(self) -> bool:
        """Whether all of the dance was handed out, and nobody asks to go elsewhere."""
        if self._dance is None:
            return round(self.danced * FPS) >= self.request.frames
        waiting = any("seek" in change for change in (*self._changes, *self._script))
        return self._dance.over and not waiting

    @property
    def can_form(self) -> bool:
        """Whether ``formation=`` may be set."""
        return (
            self._dance is not None and self._dance.can_form and self.request.constraint() is None
        )

    @property
    def can_leave(self) -> bool:
        """Whether ``dancers=`` may be set: there are several, and no places are asked for."""
        return self._dance is not None and self._dancers > 1 and self.request.constraint() is None

    @property
    def _dancers(self) -> int:
        """How many will be left once all that was asked for is done."""
        asked = [one["set"]["dancers"] for one in self._changes if "dancers" in one.get("set", {})]
        return min([self.request.dancers, *asked])

    @property
    def is_asked(self) -> bool:
        """Whether something was asked for that no segment was danced with yet."""
        return bool(self._changes)

    @property
    def has_features(self) -> bool:
        """Whether the features of the whole song are there."""
        return self._opening is None or self._opening.has_features

    def ahead(self, played: float | None = None) -> float:
        """Seconds of dance that are ready minus seconds that were played.

        By default the dance is played without a pause since its first piece was handed out.
        """
        if played is None:
            played = time.perf_counter() - self._shown if self.timing.pieces else 0.0
        return self.danced - played

    @property
    def calls(self) -> list[dict]:
        """What was asked for so far, and before which piece it was taken up."""
        return list(self._taken)

    @property
    def log(self) -> dict:
        """The options and `calls`, as plain values that JSON can hold.

        Raises: ValueError for ``constraints=`` and ``seed_motion=``, which are no plain values.
        """
        for name in ("constraints", "seed_motion"):
            if self._given.get(name):
                raise ValueError(f"a log holds plain values; leave {name}= out")
        names = {"dtype": self.request.dtype, "device": self.request.device}  # no objects of torch
        options = {
            name: value for name, value in (self._given | names).items() if value is not None
        }
        return plain({"options": options, "opening": self._seconds, "calls": self.calls})

    @classmethod
    def replay(cls, pipeline, song, log: dict, *, progress=False) -> "Stream":
        """The stream of a ``log``: the same calls before the same pieces, the same dance.

        The same machine and number of threads give the same bytes.
        """
        made = cls(pipeline, song, log["options"], progress=progress, opening=log["opening"])
        made._script.extend(log["calls"])
        return made

    def _make(self) -> Iterator[Motion]:
        with self.pipeline._ready(self.request, self._progress) as how:
            report = how.pop("report")

            def checked(done: int, total: int) -> None:
                if self._stopped:
                    raise _StoppedError
                if report is not None:
                    report(done, total)

            how["report"] = checked
            if self._dance is None:
                left = self.request.frames
                for x in self.pipeline._pieces(self.song, self.request, **how):
                    if left > 0:
                        self.begins = self.danced
                        yield self._piece(x[:, :left])
                    left -= x.shape[1]
                return
            # who dances to sound that arrives has no time to keep frames back; those that the
            # next segment dances anew must be
            eager = isinstance(self.song, LiveSong) and self.request.seam == "copy"
            eager = eager and not self.request.resampled
            for start, x in self._dance.pieces(self._take_up, eager=eager, **how):
                self.begins = start / FPS
                yield self._piece(x)

    def _piece(self, x: Tensor) -> Motion:
        """A piece with its own facts, and those of the whole dance beside them."""
        piece = self.pipeline._motion(x.clone(), self.song, self.request)
        first, frames = round(self.danced * FPS), piece.num_frames
        if frames == self.request.frames and not first:
            return piece
        whole = piece.meta
        if self._dance is not None:  # it may have been elsewhere in the song
            whole = whole | {"seams": list(self._dance.seams)}
        own = [seam - first for seam in whole["seams"] if first < seam < first + frames]
        piece.meta = whole | {"seams": own, "whole": whole}
        piece.meta.pop("swap", None)
        return piece

    def _take_up(self) -> None:
        """Do what was asked for since the last segment, and note when."""
        if self._stopped:
            raise _StoppedError
        while self._script and self._is_due(self._script[0]) and "stop" not in self._script[0]:
            self._do(self._script.popleft())
        while self._changes:
            self._do(self._changes.popleft())

    def _do(self, change: dict) -> None:
        dance = self._steered()
        if "seek" in change:
            frame = round(change["seek"] * FPS)  # of 9.99 s the last one, not the one behind it
            dance.seek(min(frame, self.request.frames - 1))
        else:
            knobs = change["set"]
            self.request = self._resolved(knobs, self.request.dancers)
            dance.ask(self.request, ordered="swap" in knobs)
            if "formation" in knobs:
                dance.form(knobs["formation"])
        self._taken.append({"piece": self.timing.pieces} | change)

    def _is_due(self, change: dict) -> bool:
        return change["piece"] <= self.timing.pieces

    def _resolved(self, knobs: dict, dancers: int) -> Any:
        """The request of so many dancers with these knobs; raises ValueError as `generate`."""
        changed = {name: value for name, value in knobs.items() if name != "formation"}
        if not changed:
            return self.request
        dancers = changed.setdefault("dancers", dancers)
        if "genre" in changed:  # what follows from a genre, the request has of the one before
            changed["genre_guidance"] = self._given.get("genre_guidance")
        if "swap" in changed:
            changed["swap_at"] = None
        elif self.request.swap is not None:
            changed["swap"] = [one for one in self.request.swap if one < dancers]
        return replace(self.request, **changed).resolve(self.pipeline.model, self.song)

    def _steered(self) -> SteeredDance:
        if self._dance is None:
            raise ValueError(
                f"the model {self.pipeline.name!r} cannot be steered while it dances this; use a "
                "model of tcdiffpp with long_sampling='lgds'"
            )
        return self._dance

    def _refuse_constraints(self, name: str) -> None:
        if self.request.constraint() is not None:
            raise ValueError(f"{name} goes with no start=, end= or constraints=; leave them out")
