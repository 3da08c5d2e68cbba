"""Sampling on another device: the same dance, and one wait a step at most.

There is no GPU here; a device made of Python (far_device.py) counts what one would be asked.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
FREE = dict.fromkeys(("foot_contact", "collision_avoidance", "order_constraint"), False)


def two_more_steps(model: str, **options) -> dict:
    command = [sys.executable, HERE / "far_device.py", model, json.dumps(options)]
    told = subprocess.run(command, check=False, capture_output=True, text=True, timeout=300)
    assert told.returncode == 0, told.stderr[-2000:]
    return json.loads(told.stdout.splitlines()[-1])


@pytest.mark.parametrize("model", ["tcdiffpp", "paper"])
def test_nothing_waits_for_the_network(model):
    two = two_more_steps(model, dancers=2, seconds=5, **FREE)
    assert not two["asked"]
    assert not two["brought"]
    assert all("send < " in line for line in two["sent"]), two["sent"]
    assert two["difference"] < 1e-3  # metres


@pytest.mark.parametrize(
    ("model", "options", "segments"),
    [
        ("tcdiffpp", {"dancers": 2, "seconds": 7.5}, 2),
        ("lodge", {"seconds": 12}, 1),  # all of them together
    ],
)
def test_bending_waits_once_a_step(model, options, segments):
    two = two_more_steps(model, **options)
    assert not two["asked"]
    assert sum(two["brought"].values()) == 2 * segments
    assert all(line.startswith("diffusion/samplers.py _hooked") for line in two["brought"])
    assert all("send" in line.split(" < ")[0] for line in two["sent"]), two["sent"]
    assert two["difference"] < 1e-3  # metres
