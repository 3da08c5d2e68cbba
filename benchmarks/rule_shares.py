"""How often each sampling rule changes what the network guessed, by more than one would notice.

    python benchmarks/rule_shares.py tcdiffpp
    python benchmarks/rule_shares.py runs/tcdiffpp/model --songs 4

A rule changes a guess in a frame when a joint of a dancer is moved by more than 1 cm, or turned by
more than 3 degrees. Rules act one after the other; each is asked what it does to the guess that
those before it left. Counted are the last guess, which becomes the dance, and all guesses of the
sampler. Songs are synthetic and of seeds that no training saw; the k-th is danced with seed k by
three dancers, who change places every second time. Where rules hardly act the network does by
itself what they are for: benchmarks/extensions.py says what dances lose without them.

Symbols (axes: b batch · n dancers · f frames · d motion features)
    before, after   a guess, normalised      (b, n, f, d)
"""

import sys
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path
from unittest import mock

import numpy as np
import roma
import tyro
from intervals import mean_with_interval
from result_table import write_table
from torch import Tensor
from tqdm.auto import tqdm

from dancediff import hub
from dancediff.extensions.collision_avoidance import CollisionAvoidance
from dancediff.extensions.constraint import Constraint, ConstraintHook, Source
from dancediff.extensions.order_constraint import OrderConstraint
from dancediff.extensions.projection import MORE_SIGNAL, Projection
from dancediff.motion.representation import TCDIFFPP, joints_of, unpack
from dancediff.music.varied import synth_varied_song

sys.path.insert(0, str(Path(__file__).parents[1] / "docs" / "site"))

from tables import RESULTS, markdown

FAR, TURNED = 0.01, 3.0  # metres, degrees
FIRST_SONG = 920_000  # no training saw it
SECONDS = 20.0
ORDERS = list(permutations(range(3)))[1:]


def changed(before: Tensor, after: Tensor) -> float:
    """Share of dancers' frames in which a joint is elsewhere; dances in metres (b, n, f, d).

    >>> import torch
    >>> x = torch.cat([torch.zeros(7), torch.eye(3)[:2].flatten().repeat(24)])
    >>> x = x.expand(1, 1, 4, 151)
    >>> moved = x.clone()
    >>> moved[..., 0, 4] += 0.02
    >>> changed(x, moved), changed(x, x)
    (0.25, 0.0)
    """
    moved = (joints_of(after) - joints_of(before)).norm(dim=-1).amax(-1) > FAR
    _, _, pose = unpack(before, TCDIFFPP)
    _, _, other = unpack(after, TCDIFFPP)
    angle = roma.rotmat_geodesic_distance(pose, other).amax(-1).rad2deg()
    return (moved | (angle > TURNED)).float().mean().item()


def rule_of(source: Source) -> str:
    """Its name in the registry. Fixed frames, where nothing else is asked, are initial ones."""
    return {
        Constraint: "initial_frames",
        CollisionAvoidance: "collision_avoidance",
        OrderConstraint: "order_constraint",
    }[type(source)]


class Counted:
    """What rules do to guesses, by their names: a share for every guess, last ones apart."""

    def __init__(self, normalizer):
        self.normalizer = normalizer
        self.all: dict[str, list[float]] = defaultdict(list)
        self.last: dict[str, list[float]] = defaultdict(list)
        self.loudest = 0.0  # signal of the last guess that was seen

    def note(self, rule: str, before: Tensor, after: Tensor, abar: float) -> None:
        """Count one guess in metres; one more signal than ever is the last of a segment."""
        share = changed(before, after)
        self.all[rule].append(share)
        if abar >= self.loudest:
            if abar > self.loudest:
                self.last.clear()
            self.loudest = abar
            self.last[rule].append(share)

    def metres(self, x: Tensor) -> Tensor:
        """A guess in metres."""
        return self.normalizer.unnormalize(x)

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Inside, every rule that acts is counted; what is danced stays the same."""
        constraint, projection = ConstraintHook.apply, Projection.apply

        def condition(hook: ConstraintHook, x: Tensor, abar: float) -> Tensor:
            for source in hook.sources:
                alone = constraint(replace(hook, sources=[source]), x, abar)
                self.note(rule_of(source), self.metres(x), self.metres(alone), abar)
            return constraint(hook, x, abar)

        def project(hook: Projection, x: Tensor, abar: float) -> Tensor:
            if abar >= MORE_SIGNAL:
                steps: list[Callable] = list(hook.steps)
                before = self.metres(x)
                for step in steps:
                    after = step(before, hook.fixed)
                    self.note(step.__name__, before, after, abar)
                    before = after
            return projection(hook, x, abar)

        with (
            mock.patch.object(ConstraintHook, "apply", condition),
            mock.patch.object(Projection, "apply", project),
        ):
            yield


@dataclass
class RuleShares:
    """Dance, count, print a row a rule; write it for a packaged model."""

    model: tyro.conf.Positional[str]
    songs: int = 8
    results: Path = RESULTS / "rule_shares.json"

    def run(self) -> None:
        """Every song once."""
        pipeline = hub.load(self.model)
        found: dict[str, list[tuple[float, float]]] = defaultdict(list)
        for k in tqdm(range(self.songs), unit="dance"):
            song, _ = synth_varied_song(FIRST_SONG + k, seconds=SECONDS)
            counted = Counted(pipeline.model.normalizer.on_cpu())
            swap = ORDERS[k % len(ORDERS)] if k % 2 else None
            with counted.watching():
                pipeline.generate(song, dancers=3, seconds=SECONDS, seed=k, swap=swap)
            for rule, shares in counted.all.items():
                found[rule].append((float(np.mean(counted.last[rule])), float(np.mean(shares))))
        table = self.table(found)
        print(markdown(table))
        if self.model == "tcdiffpp":
            write_table(self.results, table)

    def table(self, found: dict[str, list[tuple[float, float]]]) -> dict:
        """In the form of docs/results/*.json."""
        rows = [
            [f"`{rule}`", *(cell([pair[k] for pair in shares]) for k in (0, 1))]
            for rule, shares in found.items()
        ]
        return {
            "about": f"Share of dancers' frames that a rule changes by more than {100 * FAR:g} cm "
            f"or {TURNED:g} degrees, packaged model, its preset.",
            "data": f"synthetic songs of other seeds, {self.songs} of {SECONDS:g} s",
            "seed": f"0 to {self.songs - 1}",
            "intervals": "95 % bootstrap over songs",
            "command": f"python benchmarks/rule_shares.py {self.model}",
            "columns": ["rule", "of the last guess", "of all guesses that it sees"],
            "rows": rows,
        }


def cell(shares: list[float]) -> list[float | None]:
    """The mean with its interval; of a single dance (a rule that acted once) there is none."""
    return mean_with_interval(shares, ".3f")


if __name__ == "__main__":
    tyro.cli(RuleShares).run()
