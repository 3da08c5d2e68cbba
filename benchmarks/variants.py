"""What a change of a training config brings within a few minutes of computing.

    dancediff prepare choreograph 800 corpus --seconds 20
    python benchmarks/variants.py configs/tcdiffpp_small.toml corpus --minutes 6 \
        --variants "" "+frame_tokens" "+frame_tokens -non_local_filter" \
                   "+frame_tokens data.dancers_per_batch=32 model.d_model=192"

A variant is a line of changes: ``+name`` and ``-name`` add and take away an extension of the
network, ``table.key=value`` sets a key of the config. Each is trained from scratch for so many
minutes of processor time on one core (so other work on the machine does not matter much) and then
guesses held-out windows under noise of several levels. Errors are means over joints: of where a
body stands, and of its pose (joints seen from the root). A network's guess is the mean of what is
possible, so an error that falls means more is known; how a dance looks is another question, which
FID answers after longer training. What is done is kept in --out and not done again.
"""

import json
import time
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from unittest import mock

import torch
import tyro
from tqdm.auto import tqdm

from dancediff.atomic import write_text
from dancediff.data.windows import GroupCut, WindowSampler
from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.schedule import q_sample
from dancediff.extensions.build import build
from dancediff.extensions.energy_condition import has_energy_condition
from dancediff.extensions.genre_condition import genres_of
from dancediff.motion.representation import joints_of
from dancediff.papers.edge.model import EDGE
from dancediff.training import run, trainer
from dancediff.training.config import GroupData
from dancediff.training.group_takes import prepared_takes, solos_of, windows_of
from dancediff.training.schedule import learning_rate
from dancediff.training.statistics import fit_statistics

LEVELS = (980, 850, 600, 300, 100, 30)  # diffusion steps, of 1,000
BATCHES, DANCERS = 10, 20  # held-out windows: so many batches of so many dancers


def changed(tables: dict, variant: str) -> dict:
    """The tables of a config with the changes of a variant.

    >>> changed({"model": {"extensions": ["a"]}, "train": {}}, "+b -a train.lr=0.1")
    {'model': {'extensions': ['b']}, 'train': {'lr': 0.1}}
    """
    tables = {name: dict(table) for name, table in tables.items()}
    extensions = list(tables["model"]["extensions"])
    for change in variant.split():
        if change[0] == "+":
            extensions.append(change[1:])
        elif change[0] == "-":
            extensions.remove(change[1:])
        else:
            key, value = change.split("=", 1)
            table, key = key.split(".")
            tables[table][key] = json.loads(value)
    tables["model"]["extensions"] = extensions
    return tables


class Timed:
    """A training that lasts so many seconds of processor time."""

    def __init__(self, tables: dict, data: str, seconds: float):
        kind = run.MODELS[tables["model"].get("class", "TCDiffPP")]
        other = ("class", "extensions", "genres")
        sizes = {k: v for k, v in tables["model"].items() if k not in other}
        config, corpus = kind[1](**sizes), GroupData(**tables["data"])
        settings = replace(run.settings_of(tables), evaluate_every=0, steps=10**6)
        takes, held = (prepared_takes(data, config, split) for split in ("train", "val"))
        torch.manual_seed(settings.seed)
        model = build(
            kind[0], config, tables["model"]["extensions"], tables["model"].get("genres", ())
        )
        if isinstance(model, EDGE):
            takes, held = solos_of(takes), solos_of(held)
        known = {"real": corpus.real, "mirror": corpus.mirror > 0}
        fit_statistics(model, takes, settings.extensions, **known)
        how = {"seed": settings.seed, "any_song": settings.extensions.any_song}
        windows = windows_of(takes, corpus, model, **how)
        self.trainer = trainer.Trainer(model, windows, settings, None)
        cut = GroupCut(config.num_frames)
        self.held = WindowSampler(
            held,
            cut,
            genres=genres_of(model),
            energy=has_energy_condition(model),
            dancers_per_batch=DANCERS,
            seed=99,
        )
        self.settings, self.seconds, self.used, self.steps = settings, seconds, 0.0, 0

    def train(self, label: str) -> None:
        """All of it; the learning rate falls with the time that is used up."""
        self.trainer.model.train()
        planned = replace(self.settings, steps=10_000)

        def lr(step: int, config) -> float:
            done = int(min(self.used / self.seconds, 1.0) * planned.steps)
            warm = min(1.0, (step + 1) / max(1, planned.warmup))
            return warm * learning_rate(max(done, planned.warmup), planned)

        with (
            mock.patch.object(trainer, "learning_rate", lr),
            tqdm(total=self.seconds, unit="s") as bar,
        ):
            bar.set_description(label)
            while self.used < self.seconds:
                start = time.process_time()
                self.trainer.step(self.steps)
                spent = time.process_time() - start
                self.used, self.steps = self.used + spent, self.steps + 1
                bar.update(min(spent, bar.total - bar.n))

    @torch.no_grad()
    def errors(self) -> dict[int, tuple[float, float]]:
        """Of place and pose by noise level, centimetres."""
        model, errors = self.trainer.ema.model.eval(), {}
        for level in LEVELS:
            total = torch.zeros(2)
            for k in range(BATCHES):
                x, conditions, x_t, t = self._noised(k, level)
                guess = model.denoise(x_t, t, conditions)
                made = joints_of(model.normalizer.unnormalize(guess.float()))
                true = joints_of(x)
                place = made[..., :1, :] - true[..., :1, :]
                pose = made - true - place
                total += torch.stack([place.norm(dim=-1).mean(), pose.norm(dim=-1).mean()])
            errors[level] = tuple(round(100 * e, 2) for e in (total / BATCHES).tolist())
        return errors

    def _noised(self, k: int, level: int):
        model, batch = self.trainer.model, self.held.batch(k)
        x_0, M = model.normalizer.normalize(batch.x), model.music_normalizer.normalize(batch.M)
        conditions = Conditions(M, batch.label, genre=batch.genre, energy=batch.energy)
        noise = torch.randn(x_0.shape, generator=torch.Generator().manual_seed(k))
        t = torch.full((len(x_0),), level)
        return batch.x, conditions, q_sample(x_0, t, model.abar, noise).float(), t


@dataclass
class Variants:
    """Train every variant for a while and compare."""

    config: tyro.conf.Positional[Path]
    data: tyro.conf.Positional[str]
    variants: tuple[str, ...] = ("",)
    minutes: float = 6.0
    out: Path = Path("runs/variants")

    def run(self) -> None:
        """Print a row a variant."""
        torch.set_num_threads(1)
        self.out.mkdir(parents=True, exist_ok=True)
        tables = run.read_config(self.config)
        print("variant | steps | ms a step | " + " | ".join(f"t = {t}" for t in LEVELS))
        for variant in self.variants:
            row = self.row(changed(tables, variant), variant or "as it is")
            cells = [f"{place:.1f}, {pose:.2f}" for place, pose in row["errors"].values()]
            speed = round(1000 * row["seconds"] / row["steps"])
            print(" | ".join([row["variant"], str(row["steps"]), str(speed), *cells]), flush=True)

    def row(self, tables: dict, label: str) -> dict:
        """What a variant came to, from its file if it was trained before."""
        key = sha256(json.dumps([tables, self.data, self.minutes]).encode()).hexdigest()[:12]
        path = self.out / f"{key}.json"
        if not path.exists():
            timed = Timed(tables, self.data, 60 * self.minutes)
            timed.train(label)
            row = {"variant": label, "steps": timed.steps, "seconds": round(timed.used, 1)}
            write_text(path, json.dumps(row | {"errors": timed.errors()}, indent=1))
        return json.loads(path.read_text())


if __name__ == "__main__":
    tyro.cli(Variants).run()
