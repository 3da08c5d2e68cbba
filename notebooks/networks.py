"""The networks of lessons 08, 09 and 12, from the folders that `dancediff ablate` has made.

dancediff ablate configs/ablate_lessons.toml --out runs/lessons
dancediff ablate configs/ablate_lessons_lodge.toml --out runs/lessons_lodge
python notebooks/networks.py runs/lessons runs/lessons_lodge
"""

import json
import sys
import textwrap
from pathlib import Path

from dancediff import hub
from dancediff.nb import NETWORKS

NAMES = {
    "lessons": ("tcdiffpp", "configs/ablate_lessons.toml"),
    "lessons_lodge": ("lodge", "configs/ablate_lessons_lodge.toml"),
}
METRICS = ("FID_k", "FID_g", "MMC", "FSR", "joint speed")
CARD = (
    "# {name}",
    "A small network of the course (`dancediff.nb.network`), for comparisons, not for dances to "
    "show. It is the variant `{variant}` of `dancediff ablate {config}`: trained on synthetic songs "
    "and choreographed dances, seed 0. What its name says it lacks, it lacked from the start.",
    "Scores over {songs} synthetic songs that it did not learn from, with 95 % bootstrap intervals: "
    "{scores}.",
)


def variant_of(row: dict) -> str:
    """The variant's name, whichever its seed."""
    return row.get("of", row["variant"])


def card(name: str, row: dict, config: str, songs: int) -> str:
    """What a user must know of a network, with its scores."""
    scores = [
        "{} {:.3g} [{:.3g}, {:.3g}]".format(
            metric, *(row["scores"][metric][key] for key in ("value", "low", "high"))
        )
        for metric in METRICS
    ]
    facts = {"name": name, "variant": variant_of(row), "config": config, "songs": songs}
    facts["scores"] = ", ".join(scores)
    whole = {"break_long_words": False, "break_on_hyphens": False}
    return "\n\n".join(textwrap.fill(text.format(**facts), 100, **whole) for text in CARD) + "\n"


def package(runs: Path) -> None:
    """Copy the networks of one run of `dancediff ablate` to where lessons find them."""
    family, config = NAMES[runs.name]
    for row in json.loads((runs / "results.json").read_text(encoding="utf-8")):
        if "training" not in row:  # the choreographer's own dances
            continue
        name = f"{family}_{variant_of(row).replace('-', '_')}"
        model = hub.load(runs / "trainings" / row["training"] / "model").model
        songs = len(list((runs / "variants" / row["variant"]).rglob("dance_*.npz")))
        print(hub.save_model(model, NETWORKS / name, card=card(name, row, config, songs)))


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    for folder in sys.argv[1:]:
        package(Path(folder))
