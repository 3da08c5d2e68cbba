"""Two processes on one machine do what one process does with twice the batches."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from dancediff.training.config import TrainConfig
from dancediff.training.distributed import World, join_world, number_in_process
from dancediff.training.trainer import Trainer
from places import ROOT

SCRIPT = """
import sys
sys.path.insert(0, {tests!r})
from test_distributed import {run}
{run}({out!r})
"""


def in_two_processes(run, folder):
    """Call a function of this file, with the folder ``two``, in two processes at once."""
    script = folder / "go.py"
    here = str(Path(__file__).parent)
    script.write_text(SCRIPT.format(tests=here, run=run, out=str(folder / "two")))
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone"]
    folders = os.pathsep.join(str(ROOT / name) for name in ("src", "tests"))
    env = os.environ | {"PYTHONPATH": folders, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [*command, "--nproc-per-node=2", str(script)],
        env=env,
        capture_output=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr.decode()[-2000:]


def run_one(out, accumulate=1):
    """A tiny training in whatever world this process is in."""
    from dancediff.data.take import DanceTake
    from dancediff.data.windows import GroupCut, WindowSampler
    from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

    torch.manual_seed(0)
    torch.set_num_threads(1)
    takes = [DanceTake(str(n), torch.rand(n, 40, 151), M=torch.rand(40, 35)) for n in (1, 2, 3)]
    sizes = {"d_model": 16, "num_layers": 1, "ff_dim": 32, "fusion_hidden": 32}
    model = TCDiffPP(TCDiffPPConfig(**sizes, num_frames=20))
    data = WindowSampler(takes, GroupCut(20), dancers_per_batch=4)
    with join_world() as world:
        config = TrainConfig(steps=3, warmup=0, lr=1e-2, accumulate=accumulate)
        Trainer(model, data, config, Path(out), world=world).run()


def test_shares_cover_every_batch_once():
    numbers = [n for rank in range(3) for n in World(rank, 3).share(step=5, accumulate=2)]
    assert sorted(numbers) == list(range(30, 36))


def test_each_process_counts_its_own_batches(monkeypatch):
    """What happens at every second batch happens in all, not in those with odd numbers."""
    monkeypatch.setattr(torch.distributed, "is_initialized", lambda: True)
    monkeypatch.setattr(torch.distributed, "get_world_size", lambda: 2)
    for rank in (0, 1):
        numbers = [n for step in range(3) for n in World(rank, 2).share(step, accumulate=2)]
        assert [number_in_process(n) for n in numbers] == list(range(6))


def test_alone_is_the_default_world():
    with join_world() as world:
        assert (world.rank, world.size, world.first, world.device) == (0, 1, True, "cpu")


@pytest.mark.parametrize(("rank", "size"), [("2", "2"), ("-1", "2"), ("one", "2")])
def test_a_broken_launcher_is_named(rank, size, monkeypatch):
    monkeypatch.setenv("RANK", rank)
    monkeypatch.setenv("WORLD_SIZE", size)
    with pytest.raises(ValueError, match="RANK"), join_world():
        pass


@pytest.mark.slow
def test_two_processes_equal_one(tmp_path):
    in_two_processes("run_one", tmp_path)
    run_one(tmp_path / "one", accumulate=2)
    one, two = (load_file(tmp_path / name / "checkpoint.safetensors") for name in ("one", "two"))
    assert one.keys() == two.keys()
    for name, value in one.items():
        torch.testing.assert_close(value, two[name], atol=2e-6, rtol=1e-4, msg=name)
    logs = [(tmp_path / name / "losses.csv").read_text().splitlines() for name in ("one", "two")]
    for a, b in zip(*logs, strict=True):
        first, second = (line.split(",")[2:] for line in (a, b))
        if first[0][0].isdigit():
            assert [float(v) for v in first] == pytest.approx([float(v) for v in second], rel=1e-4)


def run_lodge(out):
    """Two steps of each stage with a discriminator, in whatever world this process is in."""
    from dancediff.data.take import DanceTake
    from dancediff.training.lodge import train_lodge
    from tiny_lodge import GENRES, GLOBAL, LOCAL, TINY

    torch.manual_seed(0)
    torch.set_num_threads(1)
    solos = [
        DanceTake(genre, torch.rand(1, 300, 151), M=torch.rand(300, 35), genre=genre)
        for genre in GENRES[:2]
    ]
    tables = {"data": {"windows_per_batch": 2}, "model": {"class": "Lodge"}}
    tables |= {"global_stage": GLOBAL, "local_stage": LOCAL | {"genres": list(GENRES)}}
    tables |= {"train": {"steps": 3, "warmup": 1}, "discriminator": TINY}
    with join_world() as world:
        train_lodge(tables, out, solos=solos, world=world)


@pytest.mark.slow
def test_a_discriminator_learns_in_two_processes(tmp_path):
    in_two_processes("run_lodge", tmp_path)
    header, *rows = (tmp_path / "two" / "fine_tune" / "losses.csv").read_text().splitlines()
    assert "critic" in header.split(",") and len(rows) == 3
    assert {row.count(",") for row in rows} == {header.count(",")}
