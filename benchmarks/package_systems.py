"""The packaged models of the earlier systems, from a run of `dancediff bench-models`.

    python benchmarks/package_systems.py runs/bench --minutes 10  # after bench_tables.py

Writes src/dancediff/assets/models/NAME for each of them, with a card that has the run's scores.
"""

import json
import textwrap
from dataclasses import dataclass
from pathlib import Path

import tyro

from dancediff import hub

SYSTEMS = {
    "edge": "EDGE, dancer by dancer: diffusion over single dancers.",
    "fact": "FACT, dancer by dancer: a transformer that guesses the frames after those it sees.",
    "mnet": "MNET, dancer by dancer: a generator of the next second in a genre, and a critic.",
    "bailando": "Bailando, dancer by dancer: dances as units of a codebook, chosen in turn.",
    "gcd": "GCD: group dance by diffusion and contrast.",
    "codancers": "CoDancers: a group dance as units of single dancers, all of whom choose at once.",
    "tcdiff": "TCDiff: group dance in two stages, paths over the floor first, bodies second.",
}
METRICS = ("FID_k", "FID_g", "Div_k", "GMR", "TIF", "MMC", "FSR", "PFC")
CARD = (
    "# {name}",
    "{about} {weights:.1f} M weights, fp16. It is here to be compared with, and not for dances to "
    "show: it had {minutes:g} minutes of one core, `tcdiffpp` hours.",
    "**Data.** 1,500 dances of 30 s by the procedural choreographer, to synthetic songs, and CMU "
    "motion capture with songs made to fit; no recorded song (`benchmarks/bench_tables.py` has the "
    "commands).",
    "**Training.** `dancediff bench-models {config} --minutes {minutes:g} --seeds {seed} --data "
    "data/bench`, {steps:,} steps.",
    "**Results.** {count} held-out windows of 5 s (synthetic songs, choreographed dances), bare, "
    "with 95 % bootstrap intervals: {scores}. All systems side by side: docs/results/tables.md.",
    "**Limits.** Lesson 14 shows what it does badly.{limits}",
)
LIMITS = {
    "mnet": " In dances of 15 s the pelvis sinks to 0.4 m and rises to 1.4 m (four songs).",
}


@dataclass
class PackageSystems:
    """Copy the networks of one seed to where `dancediff.load` finds them by name."""

    runs: tyro.conf.Positional[Path]
    minutes: float
    seed: int = 0
    out: Path = hub.ASSETS / "models"

    def run(self) -> None:
        """All of them."""
        for name, about in SYSTEMS.items():
            branch = self.runs / f"{name}_tiny-{self.seed}" / f"{self.minutes:g}min"
            point = json.loads((branch / "point.json").read_text(encoding="utf-8"))
            text = card(name, about, point)
            hub.save_model(hub.load(branch / "model").model, self.out / name, card=text)
            print(self.out / name)


def card(name: str, about: str, point: dict) -> str:
    """What a user must know of a network, with its scores.

    >>> scores = {"150": {"GMR": [20.123, 18.0, 22.0]}}
    >>> point = {"weights": 1e6, "minutes": 10, "config": "gcd_tiny", "seed": 0, "step": 1000,
    ...          "how": {"count": 60}, "scores": scores}
    >>> "GMR 20.1 [18, 22]" in card("gcd", SYSTEMS["gcd"], point)
    True
    """
    found = point["scores"]["150"]
    known = {m: found[m] for m in METRICS if m in found and None not in found[m]}
    scores = ["{} {:.3g} [{:.3g}, {:.3g}]".format(m, *score) for m, score in known.items()]
    facts = {"name": name, "about": about, "weights": point["weights"] / 1e6}
    facts |= {key: point[key] for key in ("minutes", "config", "seed")}
    facts |= {"steps": point["step"], "count": point["how"]["count"], "scores": ", ".join(scores)}
    facts["limits"] = LIMITS.get(name, "")
    whole = {"break_long_words": False, "break_on_hyphens": False}
    return "\n\n".join(textwrap.fill(text.format(**facts), 100, **whole) for text in CARD) + "\n"


if __name__ == "__main__":
    tyro.cli(PackageSystems).run()
