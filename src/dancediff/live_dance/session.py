r"""A live session: a stream that is danced in a thread of its own while somebody watches.

Read first: `dancediff.generation.stream`.

The thread stays ``LEAD`` seconds ahead of what is played: enough not to stop, and little enough
that a change is seen soon. Where the computer is too slow it takes fewer denoising steps, and where
these are few already, fewer dancers: who is left out stands still. When it has time again, it takes
as many steps as before.
"""

import itertools
import json
import shutil
import tempfile
import threading
import weakref
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dancediff.atomic import atomic_write
from dancediff.axes import FPS
from dancediff.generation.stream import Stream
from dancediff.motion.motion import Motion
from dancediff.music.live_song import LiveSong
from dancediff.music.song import Music
from dancediff.threads import Worker

LEAD = 5.0  # seconds of dance that are ready before the thread rests
OPENING = 30.0  # seconds of the song that are heard before the first step
FEWEST = 4  # denoising steps; with fewer, feet slide
ARRAYS = ("pose", "root", "contact")  # of a dance
RESERVE = 1.0  # seconds that must be ready still when the next piece comes
BUSY = 0.8  # share of a piece's length that its making may take
EASY = 4  # pieces in a row that left time for more steps, before more are taken


class LiveSession:
    """Dances to a song, stays ahead of the player, keeps what was danced on disk.

    - ``tell(kind, facts)`` is called from the session's thread: "piece" with ``start`` (seconds in
      the song) and ``motion``; "knob" with what was set and from which second on it is seen;
      "state"; "beats", once the whole song is heard; "failed" with a text.

    Raises: ValueError as `Pipeline.stream`, and for a model that cannot be steered.
    """

    def __init__(
        self,
        pipeline,
        song: Music | LiveSong,
        *,
        tell: Callable[[str, dict], None] = lambda kind, facts: None,
        lead: float = LEAD,
        opening: float = OPENING,
        **options,
    ):
        self.song, self.pipeline, self.lead, self._tell = song, pipeline, lead, tell
        self.listens = isinstance(song, LiveSong)
        if self.listens:  # it is as long as somebody plays, and cannot be heard in advance
            options = {"seconds": song.duration} | options
        self.stream: Stream = pipeline.stream(
            song, opening=None if self.listens else opening, **options
        )
        self.stream.set()  # refuses a model that cannot be steered
        self.dancers = self.stream.request.dancers  # in the beginning
        self.have = np.zeros(self.stream.request.frames, bool)  # frames that were danced
        self.at, self.stalls, self.slow = 0.0, 0, ""
        self.most_steps, self._easy = self.stream.request.steps, 0
        self._news = threading.Condition()
        self._folder = Path(tempfile.mkdtemp(prefix="dancediff-live-"))
        weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        self._pieces: list[tuple[int, int]] = []  # first frame in the song, and how many
        self._last: Motion
        self._stopped = False
        self._thread = Worker(self._run, stop=self.stop)

    def start(self) -> "LiveSession":
        """Begin to dance; returns at once."""
        self._thread.begin()
        return self

    @property
    def is_running(self) -> bool:
        """Whether there is a thread that dances, or waits until it must."""
        return self._thread.is_alive()

    @property
    def ahead(self) -> float:
        """Seconds of dance that are ready behind what is played now."""
        return max(self.ready_until(round(self.at * FPS)) / FPS - self.at, 0.0)

    def ready_until(self, frame: int) -> int:
        """The first frame from ``frame`` on that was not danced yet."""
        missing = np.flatnonzero(~self.have[frame:])
        return frame + int(missing[0]) if len(missing) else len(self.have)

    def played(self, seconds: float, stalls: int = 0) -> None:
        """The player says where it is, and how often it had to wait."""
        with self._news:
            self.at = min(max(float(seconds), 0.0), len(self.have) / FPS)
            self.stalls = int(stalls)
            self._news.notify_all()

    def set(self, **knobs) -> None:
        """As `Stream.set`."""
        self.stream.set(**knobs)

    def seek(self, seconds: float) -> None:
        """As `Stream.seek`; the player is there from now on.

        Raises: ValueError as `Stream.seek`, and for a microphone.
        """
        if self.listens:
            raise ValueError(
                f"seek({seconds}): a microphone hears what is played now; leave it out"
            )
        self.stream.seek(seconds)
        with self._news:  # from there on it is danced anew, so that nobody jumps
            self.have[round(seconds * FPS) :] = False
        self.played(seconds, self.stalls)

    def stop(self) -> None:
        """End the dancing; what was danced can still be saved."""
        with self._news:
            self._stopped = True
            self._news.notify_all()
        self.stream.stop()

    def join(self, seconds: float | None = None) -> None:
        """Wait until the thread has ended."""
        self._thread.join(seconds)

    def state(self) -> dict:
        """What a page shows: where the room is, seconds ahead, steps, what is wrong."""
        now = self.song.now if isinstance(self.song, LiveSong) else 0.0
        return {
            "now": round(now, 3) if now > 0 else None,  # nothing was heard yet
            "ahead": round(self.ahead, 2),
            "steps": self.stream.request.steps,
            "first": self.stream.timing.first,
            "piece": self.stream.timing.last,
            "slow": self.slow,
            "over": self.stream.is_over,
        }

    def dance(self) -> tuple[Motion, Music]:
        """All that was danced, and its sound: the song, or its parts in the order of the dance.

        Raises: ValueError when nothing was danced yet.
        """
        count = len(self._pieces)
        if not count:
            raise ValueError("nothing was danced yet; wait for the first piece")
        parts = []
        for k in range(count):
            with np.load(self._file(k)) as file:
                parts.append({name: file[name] for name in ARRAYS})
        joined = {
            name: torch.from_numpy(np.concatenate([part[name] for part in parts], axis=1))
            for name in ARRAYS
        }
        spans = self._pieces[:count]
        follow = [a + n == b for (a, n), (b, _) in itertools.pairwise(spans)]
        start, frames = spans[0][0], sum(n for _, n in spans)
        if all(follow):
            song = self.song.slice(start / FPS, (start + frames) / FPS)
        else:
            cut = [self.song.slice(a / FPS, (a + n) / FPS) for a, n in spans]
            song = Music(np.concatenate([one.audio[:] for one in cut]), cut[0].rate, cut[0].name)
        last = self._last
        meta = last.meta.get("whole", last.meta)
        meta = meta | {"seams": [seam for seam in meta["seams"] if seam < frames]}
        return Motion(fps=last.fps, skeleton=last.skeleton, meta=meta, **joined), song

    def save(self, out, formats: list[str]) -> list[Path]:
        """Write what was danced, a file for each format, and ``log.json`` to dance it again.

        With ``constraints=``, which no log can hold, there is no ``log.json``.

        Raises: ValueError for an unknown format, or when nothing was danced yet.
        """
        dance, song = self.dance()
        out = Path(out)
        out.mkdir(parents=True, exist_ok=True)
        names = [f"dance.{'smpl.npz' if name == 'smpl' else name}" for name in formats]
        files = [dance.save(out / name, song=song) for name in names]
        log = out / "log.json"
        try:
            text = json.dumps(self.stream.log, indent=1) + "\n"
        except ValueError:  # the dance is worth keeping without it
            log.unlink(missing_ok=True)  # that of an earlier dance
            return files
        with atomic_write(log) as part:
            part.write_text(text, encoding="utf-8")
        return [*files, log]

    def _file(self, k: int) -> Path:
        return self._folder / f"{k:06d}.npz"

    def _run(self) -> None:
        try:
            self._dance()
        except Exception as error:  # whoever watches must learn of it
            self._tell("failed", {"text": " ".join(str(error).split()) or type(error).__name__})
        finally:
            self.stream.stop()
            if isinstance(self.song, LiveSong):
                self.song.close()

    def _dance(self) -> None:
        noted, told = 0, False
        while not self._stopped:
            enough = self.ahead > self.lead and not self.listens  # sound that arrives sets the pace
            if self.stream.is_over or (enough and not self.stream.is_asked):
                self._rest()
                continue
            piece = next(self.stream, None)
            if piece is None:
                continue
            piece = self._with_all(piece)
            start = round(self.stream.begins * FPS)
            arrays = {name: getattr(piece, name).numpy() for name in ARRAYS}
            np.savez(self._file(len(self._pieces)), **arrays)  # a dance file would round them
            self._last = piece
            self._pieces.append((start, piece.num_frames))
            calls = self.stream.calls
            for call in calls[noted:]:  # a piece that was being made meanwhile is old, too
                if "seek" in call:
                    self.have[round(call["seek"] * FPS) :] = False
            self.have[start : start + piece.num_frames] = True
            self._tell("piece", {"start": self.stream.begins, "motion": piece})
            for call in calls[noted:]:
                self._tell("knob", call | {"from": self.stream.begins})
            noted = len(calls)
            if not told and self.stream.has_features and not self.listens:
                told = True
                self._tell("beats", {"beats": self.song.beats()})
            self._slow_down(piece.num_frames / FPS)
            self._speed_up(piece.num_frames / FPS)
            self._tell("state", self.state())

    def _rest(self) -> None:
        with self._news:
            self._news.wait(0.1)

    def _with_all(self, piece: Motion) -> Motion:
        """The piece with those who left it: they stand where they stopped."""
        n, frames = piece.num_dancers, piece.num_frames
        if n == self.dancers:
            return piece

        def with_still(name: str) -> Tensor:
            still = getattr(self._last, name)[n:, -1:]
            still = still.expand(-1, frames, *still.shape[2:])
            return torch.cat([getattr(piece, name), still])

        pose, root, contact = map(with_still, ARRAYS)
        return replace(piece, pose=pose, root=root, contact=contact)

    def _slow_down(self, length: float) -> None:
        """Ask for less if pieces take nearly as long as they are played and the next may be late.

        First for fewer steps, half as many at the least, then for a dancer less: one piece that
        took long for another reason does not cost all of them.
        """
        took, request = self.stream.timing.last, self.stream.request
        if self.stream.timing.pieces < 2 or self.stream.is_asked:
            return
        if isinstance(self.song, LiveSong):  # most of that time it waited for sound
            late, fits = self.song.now > self.stream.begins, 0
        else:
            late = took > BUSY * length and self.ahead - took <= RESERVE
            fits = int(request.steps * BUSY * length / took) if late else 0
        if not late:
            return
        if request.steps > FEWEST:
            fewer = max(fits, request.steps // 2, FEWEST)
            self.stream.set(steps=fewer)
            self.slow = f"This computer is too slow for {request.steps} steps; now it is {fewer}."
            return
        much = f"{request.dancers} dancer{'s' * (request.dancers > 1)} with {request.steps} steps"
        self.slow = f"This computer is too slow for {much}"
        if self.stream.can_leave:
            self.stream.set(dancers=request.dancers - 1)
            self.slow += f": dancer {request.dancers - 1} stands still from now on."
        else:
            self.slow += ": the dance waits for it."

    def _speed_up(self, length: float) -> None:
        """Ask for more steps again, if several pieces in a row left time for them.

        Twice as many at the most, and never more than in the beginning. With a microphone a piece
        takes as long as its sound, which says nothing about the computer: there they stay.
        """
        steps = self.stream.request.steps
        more = min(2 * steps, self.most_steps)
        fits = self.stream.timing.last * more / steps <= BUSY * length
        self._easy = self._easy + 1 if fits and more > steps and not self.stream.is_asked else 0
        if self._easy >= EASY:
            self._easy = 0
            self.stream.set(steps=more)
            self.slow = "" if more == self.most_steps else f"There is time for {more} steps again."
