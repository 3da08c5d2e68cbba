"""The preset "paper": what the papers do not have is not entered while a dance is sampled.

Every call is noted, of plain models with random weights and of the packaged ones, and compared with
the registry. An addition to sampling is a module of its own or, where it is an option of what the
papers do, too, one of OPTIONS.
"""

import sys
from importlib import import_module
from types import CodeType

import pytest

import dancediff as dd
from dancediff.extensions.build import build
from dancediff.extensions.registry import REGISTRY
from dancediff.generation.pipeline import pipeline_of
from dancediff.music.synth import synth_song
from dancediff.papers.edge.model import EDGE, EDGEConfig
from dancediff.papers.gcd.model import GCD, GCDConfig
from dancediff.papers.tcdiff.model import TCDiff, TCDiffConfig
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from tiny_lodge import tiny_lodge

TINY = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}
OURS = {e.name: e for e in REGISTRY.values() if e.kind in ("hook", "guidance", "sampling")}
OPTIONS = {  # a call of ...: what its arguments say when the addition is used
    "dpm_solver": ("dpm_step", lambda given: True),
    "same_noise": ("Pinning.__call__", lambda given: given["self"].mode == "same_noise"),
    "resampled_overlap": ("LongSampler.sampled", lambda given: given["self"].resampled > 0),
}
MODELS = {
    "tcdiffpp": lambda: build(TCDiffPP, TCDiffPPConfig(**TINY, fusion_hidden=32)),
    "edge": lambda: build(EDGE, EDGEConfig(**TINY)),
    "gcd": lambda: build(GCD, GCDConfig(**TINY)),
    "tcdiff": lambda: build(TCDiff, TCDiffConfig(**TINY, fusion_hidden=32)),
    "lodge": lambda: pipeline_of(tiny_lodge(())).model,
}
ASKED = {  # long enough for a seam; guidance rises in long dances of EDGE, as in its code
    "tcdiffpp": {"seconds": 7, "dancers": 3, "swap": [2, 0, 1]},
    "edge": {"seconds": 5, "dancers": 2},
    "gcd": {"seconds": 7, "dancers": 3, "gamma": 1.0},
    "tcdiff": {"seconds": 7, "dancers": 3},
    "lodge": {"seconds": 12, "genre": "hiphop"},
}


class Calls:
    """What is called while it is open: additions by name, and the steps of DDIM."""

    def __init__(self):
        self.modules: dict[str, list[str]] = {}
        for name in OURS.keys() - OPTIONS:
            file = import_module(f"dancediff.extensions.{OURS[name].module}").__file__
            self.modules.setdefault(file, []).append(name)
        self.entered: dict[str, set[str]] = {}  # addition: functions
        self.ddim: list[tuple[int, float]] = []  # t, eta
        self.guidance: set = set()

    def __enter__(self):
        sys.setprofile(self.note)
        return self

    def __exit__(self, *error):
        sys.setprofile(None)

    def note(self, frame, event, _):
        if event != "call":
            return
        code: CodeType = frame.f_code
        for name in self.modules.get(code.co_filename, ()):
            self.entered.setdefault(name, set()).add(code.co_qualname)
        for name, (function, used) in OPTIONS.items():
            if code.co_qualname == function and used(frame.f_locals):
                self.entered.setdefault(name, set()).add(function)
        if code.co_qualname == "ddim_step":
            self.ddim.append((frame.f_locals["t"], frame.f_locals["eta"]))
        if code.co_qualname == "guided":
            self.guidance.add(frame.f_locals["guidance"])


def check(pipeline, family: str) -> None:
    pieces = pipeline.stream(song_of_13_s(), preset="paper", seed=0, **ASKED[family])
    with Calls() as calls:
        dance = list(pieces)
    assert all(piece.joints().isfinite().all() for piece in dance)
    assert calls.entered == {}
    assert {eta for _, eta in calls.ddim} == {1.0}
    assert len({t for t, _ in calls.ddim}) == 50 and len(calls.ddim) % 50 == 0
    assert calls.guidance == {2.0}


def song_of_13_s():
    return synth_song(3, seconds=13.0)[0]


@pytest.mark.parametrize("family", MODELS)
def test_a_plain_model_dances_with_nothing_of_ours(family):
    check(pipeline_of(MODELS[family]()), family)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(MODELS.keys() & set(dd.packaged_models())))
def test_a_packaged_model_dances_with_nothing_of_ours(name):
    pipeline = dd.load(name)
    check(pipeline, pipeline.request.family)


@pytest.mark.slow
def test_what_the_packaged_models_use_is_seen():
    """So an addition that is used would not go unseen."""
    used: set[str] = set()
    asked = [
        ("tcdiffpp", ASKED["tcdiffpp"]),
        ("tcdiffpp", {"seconds": 7, "end": [(-1, 0), (0, 0), (1, 0)]}),
        ("tcdiffpp", {"seconds": 2, "genre": "jazz"}),
        ("lodge", ASKED["lodge"] | {"dancers": 2}),
    ]
    for family, options in asked:
        with Calls() as calls:
            dd.load(family).generate(song_of_13_s(), steps=3, seed=0, **options)
        used |= set(calls.entered)
    packaged = {name for name, e in OURS.items() if any(map(e.packaged_in, ("tcdiffpp", "lodge")))}
    assert packaged == used
