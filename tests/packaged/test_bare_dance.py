"""What a bench asks networks for: the window's genre and the order in which its dancers end."""

from dataclasses import replace

import numpy as np
import torch

from dancediff import nb
from dancediff.bench.held_out import Window
from dancediff.bench.model_bench import bare_dance
from dancediff.data.choreographed import choreographed_takes
from dancediff.motion.motion import Motion
from dancediff.motion.order import swap_mode


def test_who_can_be_asked_is_asked(monkeypatch):
    asked = {}
    model = nb.network("tcdiffpp_complete")
    monkeypatch.setattr(type(model), "generate", lambda self, window, **options: asked | options)
    motion = choreographed_takes(0, seconds=3.0, sizes=(3,))[0].motion
    window = Window("w", "synthetic", motion, torch.zeros(90, 35), np.arange(6) / 2, "house")
    options = bare_dance(model, window, 5, steps=2)
    x = window.motion.root[..., 0]
    assert options["swap"] == tuple(swap_mode(x[:, 0], x[:, -1]).tolist())
    assert (options["genre"], options["seed"], options["dancers"]) == ("house", 5, 3)
    assert options["genre_guidance"] == 1
    assert "genre" not in bare_dance(model, replace(window, genre="polka"), 5, steps=2)
    alone = Motion(window.motion.pose[:1], window.motion.root[:1])
    assert "swap" not in bare_dance(model, replace(window, motion=alone), 5, steps=2)
