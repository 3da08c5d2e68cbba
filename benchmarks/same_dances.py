"""Does the code of today dance what the code of an earlier commit danced?

Six dances of each packaged model are made twice, each time by a process of its own: with the source
tree of the commit, which is checked out to a temporary folder, and with the one of today. The
largest distance between two joints says how far apart they are. One thread, so that sums are
rounded alike. Both hear the same features, those of today: beats are found differently since that
commit, and with other beats every dance is another one.

    python benchmarks/same_dances.py                     # against the commit before the redesign
    python benchmarks/same_dances.py --only tcdiffpp1 lodge2
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import dancediff as dd

ROOT = Path(__file__).parents[1]
BEFORE = "578802b"  # the last commit before the redesign
NEAR = 1e-4  # metres

# The same requests in the words of that commit and in those of today.
DANCES = {
    "tcdiffpp": [
        {"dancers": 1, "seconds": 8, "seed": 1},
        {"dancers": 3, "seconds": 12, "seed": 2},
        {"dancers": 5, "seconds": 11, "seed": 3, "swap": [1, 0, 2, 3, 4]},
        {
            "dancers": 3,
            "seconds": 8,
            "seed": 4,
            "start": [[-1, 0], [0, 1], [1, 0]],
            "end": [[1, 0], [0, 1], [-1, 0]],
        },
        {
            "dancers": 2,
            "seconds": 8,
            "seed": 5,
            "sampler": "ddim",
            "steps": 20,
            "eta": 1.0,
            "guidance": 2.0,
            "autoguidance": 1.0,
            "foot_contact": False,
            "collision_avoidance": False,
            "order_constraint": False,
            "seam": "fade",
        },
        {"dancers": 4, "seconds": 9, "seed": 6, "pinning": "init", "overlap": 60, "steps": 16},
    ],
    "lodge": [
        {"seconds": 20, "seed": 1},
        {"dancers": 3, "relation": "canon", "formation": "V", "seconds": 20, "seed": 2},
        {"seconds": 18, "seed": 3, "genre": "salsa", "soft": 0.5},
        {
            "seconds": 18,
            "seed": 4,
            "sampler": "ddim",
            "steps": 20,
            "eta": 1.0,
            "guidance": 2.0,
            "autoguidance": 1.0,
            "foot_contact": False,
        },
        {"seconds": 20, "seed": 5, "stage_spots": False, "mirror": False, "at_once": 1},
        {"seconds": 30, "seed": 6, "beat_align": False, "dancers": 2, "relation": "mirror"},
    ],
}
THEN = {  # option of today: its name and values before
    "foot_contact": ("feet", {True: "planted", False: "free"}),
    "collision_avoidance": ("spacing", {True: "kept", False: "free"}),
    "order_constraint": ("order", {True: "kept", False: "free"}),
    "stage_spots": ("home", {True: True, False: False}),
}
MAKE = """
import json, sys
import numpy as np
import torch
import dancediff as dd
torch.set_num_threads(1)
name, folder, wanted = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
model, song = dd.load(name), dd.packaged_song()
heard = torch.from_numpy(np.load(f"{folder}/../music.npy"))
type(song).features = lambda song: heard
type(song).beats = lambda song: np.flatnonzero(heard[:, 34]) / 30
for k, options in wanted.items():
    np.save(f"{folder}/{name}{k}.npy", model.generate(song, **options).joints().numpy())
"""


def in_old_words(options: dict) -> dict:
    """The same request as the earlier commit understands it."""
    old = {}
    for key, value in options.items():
        name, values = THEN.get(key, (key, None))
        old[name] = value if values is None else values[value]
    return old


def make(source: Path, folder: Path, name: str, wanted: dict) -> None:
    """Dance with the source tree ``source``; joints go to ``folder``."""
    folder.mkdir(exist_ok=True)
    env = os.environ | {"PYTHONPATH": str(source), "OMP_NUM_THREADS": "1"}
    call = [sys.executable, "-c", MAKE, name, str(folder), json.dumps(wanted)]
    subprocess.run(call, env=env, check=True)


def main() -> int:
    """Print one line a dance; exit status 1 if one of them is too far."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--before", default=BEFORE, help="commit to compare with")
    parser.add_argument("--only", nargs="*", default=[], help="such as tcdiffpp1 lodge2")
    args = parser.parse_args()
    worst = 0.0
    with tempfile.TemporaryDirectory() as temporary:
        tree, folder = Path(temporary) / "tree", Path(temporary)
        np.save(folder / "music.npy", dd.packaged_song().features().numpy())
        add = ["git", "-C", str(ROOT), "worktree", "add", "--detach", "-q", str(tree), args.before]
        subprocess.run(add, check=True)
        try:
            for name, dances in DANCES.items():
                wanted = {
                    k: options
                    for k, options in enumerate(dances)
                    if not args.only or f"{name}{k}" in args.only
                }
                if not wanted:
                    continue
                then = {k: in_old_words(options) for k, options in wanted.items()}
                make(tree / "src", folder / "then", name, then)
                make(ROOT / "src", folder / "now", name, wanted)
                for k in wanted:
                    a, b = (np.load(folder / when / f"{name}{k}.npy") for when in ("then", "now"))
                    far = float(np.abs(a - b).max()) if a.shape == b.shape else float("inf")
                    worst = max(worst, far)
                    print(f"{name} {k}: {a.shape[0]} dancers, {a.shape[1]} frames, {far:.1e} m")
        finally:
            remove = ["git", "-C", str(ROOT), "worktree", "remove", "--force", str(tree)]
            subprocess.run(remove, check=True)
    verdict = "the same" if worst < NEAR else "NOT the same"
    print(f"largest distance between two joints {worst:.1e} m: {verdict} dances")
    return int(worst >= NEAR)


if __name__ == "__main__":
    sys.exit(main())
