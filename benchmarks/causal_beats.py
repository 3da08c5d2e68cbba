r"""What `CausalMusic` knows of songs as they play, against the whole songs.

    python benchmarks/causal_beats.py --data FOLDER OTHER --songs 12

Takes as many songs of each folder, spread evenly over its names, and hears two minutes of each in
blocks of 0.2 s, without waiting. The first 5 s are not scored. F-scores (70 ms) are against the
beats that are tracked in the whole song. A beat counts as foretold if it was when it lay 1 s (3 s)
ahead; beats less than half an interval after the one before are left out. Correlations are means
over a block's columns, of rows when their time comes (or when they lie 1 s ahead), with those of
the whole song. The cost is processor time a second of sound, a window of the features every 2.5 s
included. MMC is that of a trio of the packaged TCDiff++ from second 10 on: each segment knows only
what was heard `LEAD` seconds before its new part begins, the first one when it begins.

Symbols (axes: f frames at 30 a second · m = 35 features · k segments)
    M   features of the whole song                           (f, m)
    W   features as they were known when their time came     (f, m)
"""

import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
import tyro
from beats import f_score
from result_table import write_table
from tqdm.auto import tqdm

import dancediff as dd
from dancediff.axes import FPS
from dancediff.generation.segments import SegmentPlan
from dancediff.generation.tcdiffpp_dance import long_group_sampler
from dancediff.metrics.rhythm import beat_alignment
from dancediff.motion.motion import Motion
from dancediff.music.causal import CausalMusic
from dancediff.music.features import CHROMA, MFCC, ONSET
from dancediff.music.song import Music
from dancediff.music.sound_on_disk import SOUND_SUFFIXES
from dancediff.music.sound_sources import played

LONGEST, SKIP = 120.0, 5.0  # seconds
AHEAD = (0.0, 1.0, 3.0)  # seconds before a beat at which it must be known
START, SECONDS, LEAD = 10.0, 20.0, 1.0  # of dances
COLUMNS = ["song", "beats known", "1 s ahead", "3 s ahead", "onset", "MFCC", "chroma"]
COLUMNS += ["onset, 1 s ahead", "MFCC, 1 s ahead", "% of a core", "MMC, whole", "MMC, causal"]


@dataclass
class Foretold:
    """Beats as they were foretold so many seconds before they came."""

    ahead: float
    times: list[float] = field(default_factory=list)

    def note(self, beats: np.ndarray, before: float, now: float) -> None:
        """Beats that have come within reach since ``before``.

        >>> known = Foretold(1.0, [1.0])
        >>> known.note(np.array([1.0, 1.5, 1.6, 2.0, 2.5]), 0.4, 1.2)      # until 2.2; 1.6 is close
        >>> known.times
        [1.0, 1.5, 2.0]
        """
        gap = np.diff(beats[-9:]).mean() / 2 if len(beats) > 1 else 0.0
        for beat in beats[(beats > before + self.ahead) & (beats <= now + self.ahead)]:
            if not self.times or beat - self.times[-1] > gap:
                self.times.append(float(beat))


@dataclass
class Listened:
    """What was known of a song while it played, and what it cost."""

    foretold: list[Foretold]
    known: list[torch.Tensor]  # rows when their time came
    coming: list[torch.Tensor]  # rows a second before
    cost: float = 0.0  # seconds of the processor


def listen(song: Music) -> Listened:
    """Hear a song in blocks and note what is known."""
    music, heard = CausalMusic(song.rate), Listened([Foretold(s) for s in AHEAD], [], [])
    asked = 0
    for block in played(song, block=0.2, in_real_time=False):
        before, frame, begin = music.now, music.num_frames, time.process_time()
        music.push(block)
        if music.num_frames >= asked + 2.5 * FPS:  # as often as a segment begins
            asked = music.num_frames
            music.window(max(music.first_frame, asked - 5 * FPS), 5 * FPS)
        heard.cost += time.process_time() - begin
        new = music.num_frames - frame
        if not new:
            continue
        beats = music.beats()
        for one in heard.foretold:
            one.note(beats, before, music.now)
        if frame == 0:
            heard.coming.append(torch.zeros(FPS, 35))  # the first second was never ahead
        heard.known.append(music.window(frame, new))
        heard.coming.append(music.window(frame + FPS, new))
    return heard


def correlation(W: torch.Tensor, M: torch.Tensor, block: slice) -> float:
    """Mean over a block's columns of Pearson's correlation; columns that never change are left out.

    >>> M = torch.arange(300.0)[:, None].expand(300, 35)
    >>> round(correlation(2 * M, M, MFCC), 6)
    1.0
    """
    k = min(len(W), len(M))
    a, b = (X[round(SKIP * FPS) : k, block].double() for X in (W, M))
    a, b = a - a.mean(0), b - b.mean(0)
    size = a.norm(dim=0) * b.norm(dim=0)
    return ((a * b).sum(0)[size > 1e-9] / size[size > 1e-9]).mean().item()


class Part:
    """A part of a song, with the features that the whole song has there."""

    def __init__(self, song: Music, start: float, seconds: float):
        self._part = song.slice(start, start + seconds)
        first = round(start * FPS)
        self.M = song.features()[first : first + self._part.num_frames]

    def features(self) -> torch.Tensor:
        """(f, 35), raw."""
        return self.M

    def __getattr__(self, name: str):
        return getattr(self._part, name)


def causal_dance(pipeline, song: Music, part: Part) -> Motion:
    """The dance that a group makes up while it hears the song."""
    request = pipeline.resolve(part, dancers=3, seconds=SECONDS)
    segments = SegmentPlan.of(request, pipeline.config.num_frames)
    music, sound, rows, energy = CausalMusic(song.rate), played(song, in_real_time=False), [], []
    for k in range(segments.count):
        begin = round(START * FPS) + k * segments.stride
        # when something new is seen, less the time that it takes to make it
        due = begin + segments.overlap - round(LEAD * FPS) if k else begin
        while music.num_frames < due:
            music.push(next(sound))
        rows.append(music.window(begin, segments.window))
        energy.append(music.energy(begin, segments.window))
    model = pipeline.model
    with torch.inference_mode(), pipeline._ready(request, False) as how:
        sampler = long_group_sampler(model, part, request, dtype=how["dtype"])
        style = dict(sampler.style)
        if "energy" in style:
            style["energy"] = torch.stack(energy).to(style["energy"])
        M = model.music_normalizer.normalize(torch.stack(rows).to(model.abar.device))
        pieces = [p.cpu() for p in replace(sampler, music=M, style=style).pieces()]
        x = model.normalizer.on_cpu().unnormalize(torch.cat(pieces, dim=1))
    return Motion.from_features(x[:, : request.frames].clone(), fps=FPS)


def rhythm(pipeline, song: Music) -> list[float | None]:
    """MMC of a dance to the whole song, and of one to the song as it plays; None without beats."""
    beats = song.beats() - START
    beats = beats[(beats > 0) & (beats < SECONDS)]
    if len(beats) < SECONDS / 2 or song.duration < START + SECONDS + 1:
        return [None, None]
    part = Part(song, START, SECONDS + 1)
    whole = pipeline.generate(part, dancers=3, seconds=SECONDS)
    dances = (whole, causal_dance(pipeline, song, part))
    return [float(beat_alignment(d.joints(), beats, direction="motion")) for d in dances]


def songs_of(folder: Path, most: int) -> list[Path]:
    """Sound files of a folder, at most so many, spread evenly over their names."""
    found = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SOUND_SUFFIXES)
    return [found[k * len(found) // most] for k in range(most)] if len(found) > most else found


@dataclass
class CausalBeats:
    """Score `CausalMusic` on songs; print and write docs/results/causal_music.json."""

    data: list[Path]
    songs: int = 12
    dances: bool = True
    out: Path = Path("docs/results/causal_music.json")

    def run(self) -> None:
        """Everything, song by song."""
        pipeline, rows = dd.load("tcdiffpp") if self.dances else None, []
        for path in tqdm([p for folder in self.data for p in songs_of(folder, self.songs)]):
            song = Music.load(path).slice(0, LONGEST)
            heard, M, truth = listen(song), song.features(), song.beats()
            if not (truth > SKIP).any():
                print(f"{path.stem}: no beat in the whole song, not scored")
                continue
            W, coming = torch.cat(heard.known), torch.cat(heard.coming)
            found = [f_score(np.array(one.times), truth) for one in heard.foretold]
            alike = [correlation(W, M, block) for block in (ONSET, MFCC, CHROMA)]
            alike += [correlation(coming, M, block) for block in (ONSET, MFCC)]
            cost = 100 * heard.cost / song.duration
            mmc = rhythm(pipeline, song) if pipeline else [None, None]
            rows.append([path.stem, *found, *alike, cost, *mmc])
            print(*cells(rows[-1]), sep=" | ", flush=True)
        rows.append(["mean", *map(mean, zip(*(row[1:] for row in rows), strict=True))])
        table = {
            "about": "F-scores (70 ms) of beats and correlations of features of songs as they "
            "play, against the whole songs; processor time a second of sound; MMC of trios.",
            "data": "real, recorded songs",
            "command": f"python benchmarks/causal_beats.py --data … … --songs {self.songs}",
            "columns": COLUMNS,
            "rows": [cells(row) for row in rows],
        }
        write_table(self.out, table)
        print(*table["rows"][-1], sep=" | ")


def mean(values) -> float | None:
    """Of those that there are."""
    there = [value for value in values if value is not None]
    return float(np.mean(there)) if there else None


def cells(row: list) -> list:
    """Numbers with two digits."""
    return [round(value, 2) if isinstance(value, float) else value for value in row]


if __name__ == "__main__":
    tyro.cli(CausalBeats).run()
