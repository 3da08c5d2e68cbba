"""How fast it is: every figure beside what a user would write without thinking of speed.

    python benchmarks/speed.py --song SONG.ogg --json out/speed.json

The naive way is 50 steps of DDIM, two passes for guidance, a scan that indexes frames, float32;
nothing keeps feet or distances there. Both ways run one after the other, in the same process, after
one short dance to warm up. Other packages: ``--mambapy mambapy`` (an importable module) adds a
column to the scans. One line a figure, then all of them as JSON.
"""

import contextlib
import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from unittest import mock

import numpy as np
import torch
import tyro

from dancediff import hub
from dancediff.atomic import write_text
from dancediff.data.augment import Augmentation
from dancediff.data.choreographed import choreographed_corpus
from dancediff.data.windows import GroupCut, WindowSampler
from dancediff.diffusion.guidance import guided
from dancediff.extensions import ssd
from dancediff.generation import guided_denoiser
from dancediff.generation.pipeline import pipeline_of
from dancediff.generation.presets import PACKAGED
from dancediff.nn import ssm
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training import run
from dancediff.training.statistics import fit_statistics
from dancediff.training.trainer import Trainer

PARTS = ("start", "features", "group", "paper", "lodge", "training", "scan", "video")
RECIPE = Path(__file__).parent.parent / "configs" / "tcdiffpp_small.toml"
WARM_UP, STEPS = 5, 40
LENGTHS = (128, 256, 512, 1024, 2048, 4096, 8192, 16384)


@dataclass
class Args:
    """What to measure."""

    song: Path | None = None
    """At least 60 s; default: the packaged song, twice."""
    only: list[str] = field(default_factory=lambda: list(PARTS))
    """Some of: start, features, group, paper, lodge, training, scan, video."""
    threads: int = 2
    mambapy: str | None = None
    """Name of a module with ``pscan``, to compare scans with."""
    json: Path | None = None


def seconds(work, repeat: int = 1) -> float:
    """The shortest of several runs."""
    best = float("inf")
    for _ in range(repeat):
        begun = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - begun)
    return best


def indexed_scan(u, delta, A, B, C, D_skip):
    """The recurrence as one would write it down first."""
    state = u.new_zeros(u.shape[0], *A.shape)
    y = torch.zeros_like(u)
    for f in range(u.shape[1]):
        decay = torch.exp(delta[:, f, :, None] * A)
        state = decay * state + (delta[:, f] * u[:, f])[..., None] * B[:, f, None]
        y[:, f] = (state * C[:, f, None]).sum(-1)
    return y + D_skip * u


def indexed_ssd(u, delta, A, B, C, D_skip, **_):
    """The same for one decay a head."""
    wide = u.shape[-1] // len(A)
    A_ = A.repeat_interleave(wide)[:, None].expand(-1, B.shape[-1])
    delta_ = delta.repeat_interleave(wide, -1)
    return indexed_scan(u, delta_, A_, B, C, D_skip.repeat_interleave(wide))


def two_passes(denoise, conditions, guidance):
    """Guidance as two runs of the network."""
    alone = [guided(denoise, conditions, w) for w in (1.0, 0.0)]

    def denoise(x_t, t):
        conditional, unconditional = (one(x_t, t) for one in alone)
        return unconditional + guidance * (conditional - unconditional)

    return denoise


@contextlib.contextmanager
def naive():
    """Put the naive parts in the places of ours."""
    with (
        mock.patch.object(ssd, "ssd_scan", indexed_ssd),
        mock.patch.object(ssm, "selective_scan", indexed_scan),
        mock.patch.object(guided_denoiser, "guided", two_passes),
        mock.patch("dancediff.nn.conditioning._same_place", lambda a, b: False),
    ):
        yield


NAIVE = {"sampler": "ddim", "steps": 50, "guidance": 2.0, "autoguidance": 1.0}
BARE = dict.fromkeys(("foot_contact", "collision_avoidance", "order_constraint"), False)


def start_up(args: Args) -> list[dict]:
    """Processes of their own, the second of two: the first reads files from disk."""
    rows = []
    for name, words in {
        "dancediff generate --help": ["-m", "dancediff.cli", "generate", "--help"],
        "import dancediff": ["-c", "import dancediff"],
        "python -c pass": ["-c", "pass"],
    }.items():
        command = [sys.executable, *words]
        took = seconds(lambda run=command: subprocess.run(run, check=True, capture_output=True), 3)
        rows.append({"what": name, "seconds": took})
    return rows


def features(args: Args) -> list[dict]:
    """A minute of music, after librosa has compiled itself."""
    song = loaded(args).slice(0, 60)
    song.slice(0, 5).features()
    return [{"what": "features of 60 s", "seconds": seconds(song.features)}]


def group(args: Args) -> list[dict]:
    """60 s with the packaged model, features included."""
    model = hub.load("tcdiffpp")
    model.generate(loaded(args), seconds=5)
    rows, took = [], {}
    for name, dancers, options in (
        ("3 dancers", 3, {}),
        ("5 dancers", 5, {}),
        ("3 dancers, naive", 3, NAIVE | BARE),
    ):
        song = loaded(args).slice(0, 60)
        with naive() if options else contextlib.nullcontext():
            took[name] = seconds(
                lambda s=song, n=dancers, o=options: model.generate(s, dancers=n, **o)
            )
        row = {
            "what": f"tcdiffpp, 60 s, {name}",
            "seconds": took[name],
            "times real": 60 / took[name],
        }
        rows.append(row)
    rows[0]["times naive"] = took["3 dancers, naive"] / took["3 dancers"]
    return rows


def paper(args: Args) -> list[dict]:
    """TCDiff++ at the paper's size, untrained: what it draws does not matter for its speed."""
    torch.manual_seed(0)
    model = pipeline_of(TCDiffPP(TCDiffPPConfig.paper()).eval())
    song = loaded(args).slice(0, 5)
    song.features()
    usual = {"sampler": "dpm", "steps": PACKAGED["tcdiffpp"]["steps"], "guidance": 1.0}
    ways = {
        "float32": usual,
        "bfloat16": usual | {"dtype": torch.bfloat16},
        "bfloat16, guidance 2": usual | {"dtype": torch.bfloat16, "guidance": 2.0},
        "naive": {k: v for k, v in NAIVE.items() if k != "autoguidance"},
    }
    rows = []
    for name, options in ways.items():
        with naive() if name == "naive" else contextlib.nullcontext():
            free = {"seconds": 5, "dancers": 3, "foot_contact": False}
            took = seconds(lambda o=options, f=free: model.generate(song, **f, **o))
        rows.append({"what": f"paper size, 150 frames, {name}", "seconds": took})
    for row in rows[:-1]:
        row["times naive"] = rows[-1]["seconds"] / row["seconds"]
    return rows


def lodge(args: Args) -> list[dict]:
    """Five minutes of a solo with the packaged Lodge, features included."""
    song, model = loaded(args), hub.load("lodge")
    model.generate(song, seconds=9, steps=2)
    long = hub.Music(np.tile(song.slice(0, 60).audio, (5, 1)), song.rate)
    took = seconds(lambda: model.generate(long))
    return [{"what": "lodge, 300 s", "seconds": took, "times real": 300 / took}]


def training(args: Args) -> list[dict]:
    """Steps of the packaged recipe: clips a second, and the share of it that waits for data."""
    config = run.read_config(RECIPE)
    takes = choreographed_corpus(range(4), seconds=30, workers=args.threads)
    rows = []
    for precision in ("fp32", "bf16"):
        torch.manual_seed(0)
        model = TCDiffPP(TCDiffPPConfig(**config["model"]))
        settings = run.settings_of(config)
        fit_statistics(model, takes, settings.extensions, mirror=True)
        data = Timed(WindowSampler(takes, GroupCut(), swaps=0.3, augment=Augmentation(mirror=0.5)))
        settings = replace(settings, precision=precision)
        trainer = Trainer(model, data, settings)
        model.train()
        for step in range(WARM_UP + STEPS):
            if step == WARM_UP:
                data.seconds, data.clips, begun = 0.0, 0, time.perf_counter()
            trainer.step(step)
        took = time.perf_counter() - begun
        rows.append(
            {
                "what": f"training tcdiffpp, {precision}",
                "clips a second": data.clips / took,
                "steps a second": STEPS / took,
                "% waiting for data": 100 * data.seconds / took,
            }
        )
    rows[1]["times fp32"] = rows[1]["clips a second"] / rows[0]["clips a second"]
    return rows


class Timed:
    """A data set that knows how long its batches took, and how many dancers were in them."""

    def __init__(self, data):
        self.data, self.seconds, self.clips = data, 0.0, 0

    def batch(self, number: int) -> tuple:
        """The data set's own."""
        begun = time.perf_counter()
        batch = self.data.batch(number)
        self.seconds += time.perf_counter() - begun
        self.clips += batch[0].shape[0] * batch[0].shape[1]
        return batch


def scan(args: Args) -> list[dict]:
    """Forward and backward of one scan: seconds, and MB that are kept for the way back."""
    s, rows = 16, []
    pscan = args.mambapy and importlib.import_module(f"{args.mambapy}.pscan").pscan
    sizes = [(6, 150, 1024), *((3, f, 256) for f in LENGTHS)]  # the first is the paper's
    for b, f, d in sizes:
        rng = torch.Generator().manual_seed(0)
        normal, uniform = partial(torch.randn, generator=rng), partial(torch.rand, generator=rng)
        u, delta = normal(b, f, d), uniform(b, f, d)
        A, B, C = -uniform(d, s), normal(b, f, s), normal(b, f, s)
        heads = d // 64
        inputs = [x.requires_grad_() for x in (u, delta, A, B, C, torch.ones(d))]
        tied = [x.requires_grad_() for x in (u, uniform(b, f, heads), -uniform(heads), B, C,
                                             torch.ones(heads))]  # fmt: skip
        row = {"what": f"scan, {b} x {f} frames, {d} channels"}
        ways = {"loop": (ssm.selective_scan, inputs), "ssd": (ssd.ssd_scan, tied)}
        if f <= 1024:
            ways["indexed"] = (indexed_scan, inputs)
        if pscan:
            ways["pscan"] = (lambda *x: by_pscan(pscan, *x), inputs)
        for name, (work, given) in ways.items():
            row[f"{name} s"] = seconds(lambda w=work, g=given: w(*g).sum().backward(), 2)
            row[f"{name} MB"] = kept_for_backward(lambda w=work, g=given: w(*g))
        rows.append(row)
    return rows


def kept_for_backward(work) -> float:
    """MB of tensors that autograd holds after a forward pass."""
    sizes = {}

    def hold(x):
        sizes[x.untyped_storage().data_ptr()] = x.untyped_storage().nbytes()
        return x

    with torch.autograd.graph.saved_tensors_hooks(hold, lambda x: x):
        y = work()
    del y
    return sum(sizes.values()) / 1e6


def by_pscan(pscan, u, delta, A, B, C, D_skip):
    """The same recurrence through another package's parallel scan."""
    decay = torch.exp(delta[..., None] * A)
    states = pscan(decay, (delta * u)[..., None] * B[:, :, None])
    return (states @ C[..., None]).squeeze(-1) + D_skip * u


def video(args: Args) -> list[dict]:
    """20 s of three dancers as an .mp4 with music, and the same as a page that plays it."""
    song = loaded(args)
    dance = hub.load("tcdiffpp").generate(song, seconds=20, steps=4)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for suffix in ("mp4", "html"):
            path = Path(folder, f"dance.{suffix}")
            took = seconds(lambda p=path: dance.save(p, song=song), 3)
            size = path.stat().st_size / 1e6
            rows.append({"what": f".{suffix} of 20 s", "seconds": took, "MB": size})
    return rows


def loaded(args: Args):
    """A song of a minute or more, nothing of it known yet."""
    if args.song is not None:
        return hub.Music.load(args.song)
    song = hub.packaged_song()
    return hub.Music(np.tile(song.audio, (2, 1)), song.rate, song.name)


def main(args: Args) -> None:
    """Measure, print, write."""
    torch.set_num_threads(args.threads)
    work = {"start": start_up, "features": features, "group": group, "paper": paper,
            "lodge": lodge, "training": training, "scan": scan, "video": video}  # fmt: skip
    rows = []
    for name in args.only:
        for row in work[name](args):
            rows.append(row)
            numbers = (f"{k} {v:.3g}" for k, v in row.items() if k != "what")
            print(f"{row['what']:40s}", ", ".join(numbers), flush=True)
    facts = {"threads": args.threads, "cores": os.cpu_count(), "torch": torch.__version__}
    if args.json:
        write_text(args.json, json.dumps({"machine": facts, "rows": rows}, indent=1))


if __name__ == "__main__":
    main(tyro.cli(Args))
