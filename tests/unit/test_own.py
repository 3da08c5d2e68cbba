"""Code of the user's own: what is refused, and what is said of parts that do not fit."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from dancediff import hub
from dancediff.cli import main
from dancediff.data.choreographer import choreograph
from dancediff.diffusion.samplers import SamplerOptions, sample
from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions.build import build
from dancediff.extensions.networks import ExtendedTCDiffPP
from dancediff.generation.tcdiffpp_request import TCDiffPPRequest
from dancediff.metrics.report import evaluate_dances
from dancediff.nn.losses import compare
from dancediff.own import own_digests, own_part
from dancediff.papers.edge.model import EDGE
from dancediff.papers.lodge.model import Lodge
from dancediff.papers.tcdiffpp.losses import LossWeights, five_losses
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.config import TrainingExtensions
from dancediff.training.extended_losses import extended_losses
from dancediff.training.network_check import check_network
from dancediff.training.run import check_tables

SIZES = {"d_model": 16, "num_layers": 1, "num_heads": 2, "ff_dim": 32, "fusion_hidden": 32}
TINY = TCDiffPPConfig(**SIZES, num_frames=20)
HERE = __name__


class Mean(nn.Module):
    def forward(self, h):
        return h + h.mean(1, keepdim=True)


class Half(nn.Module):
    def forward(self, h):
        return h[..., :4]


class MeanFusion(TCDiffPP):
    def __init__(self, config):
        super().__init__(config)
        self.decoder.fusion_projection = Mean()


class Narrow(TCDiffPP):
    def __init__(self, config):
        super().__init__(config)
        self.decoder.fusion_projection = Half()


class Deaf(TCDiffPP):
    def __init__(self, config):
        super().__init__(config)
        self.decoder.fusion_projection = nn.Sequential(nn.Linear(3, 3))


class Extended(ExtendedTCDiffPP):
    pass


class Solo(EDGE):
    pass


class MyLodge(Lodge):
    pass


def two_numbers(c):
    return c.x_hat.mean((0, 1))


def deaf_loss(c):
    return c.x_0.mean()


def broken_loss(c):
    return c.no_such_thing.mean()


def longer(x_t, x0_hat, *where, **how):
    return torch.cat([x0_hat, x0_hat], dim=1)


def nowhere(joints, *, fps):
    return joints[99]


def endless(joints, *, fps):
    return float("inf")


def frames(joints, *, fps):
    return joints.shape[1]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mine", "form 'module:name'"),
        ("mine:", "form 'module:name'"),
        ("os; system:x", "form 'module:name'"),
        ("no_such_module_here:f", r"cannot be imported \(ModuleNotFoundError"),
        ("broken_part:f", r"cannot be imported \(ZeroDivisionError"),
        ("math:hypott", "has no 'hypott'"),
    ],
)
def test_names_that_lead_nowhere(tmp_path, monkeypatch, name, words):
    (tmp_path / "broken_part.py").write_text("1 / 0")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    with pytest.raises(ValueError, match=words):
        own_part(name, "class")


@pytest.mark.parametrize(
    ("outer", "changed"),
    [
        ("from part_inside import f\n", "part_inside.py"),
        ("from functools import partial\nf = partial(max)\n", "part_outside.py"),
    ],
)
def test_a_digest_changes_with_the_file_that_is_named_and_the_one_that_defines(
    tmp_path, monkeypatch, outer, changed
):
    monkeypatch.syspath_prepend(tmp_path)
    for name, text in (("part_outside", outer), ("part_inside", "def f(x):\n    return x\n")):
        (tmp_path / f"{name}.py").write_text(text)
        monkeypatch.delitem(sys.modules, name, raising=False)
    names = ["part_outside:f", "TCDiffPP", None]
    seen = [own_digests(names), own_digests(names)]
    with (tmp_path / changed).open("a") as file:
        file.write("# another word\n")
    assert seen[0] == seen[1] != own_digests(names)
    assert seen[0].keys() == {"part_outside:f"}


def test_a_part_of_another_shape_is_named():
    check_network(MeanFusion(TINY), TCDiffPP)
    with pytest.raises(
        ValueError,
        match=r"part 'decoder.fusion_projection' \(Half\) returns \(2, 3, 20, 4\) .*needs "
        r"\(2, 3, 20, 16\) there",
    ):
        check_network(Narrow(TINY), TCDiffPP)
    with pytest.raises(
        ValueError, match=r"'decoder.fusion_projection.0' \(Linear\) fails on \(2, 3, 20, 16\): Run"
    ):
        check_network(Deaf(TINY), TCDiffPP)


def test_the_check_changes_neither_random_numbers_nor_the_network():
    model = MeanFusion(TINY).train()
    before = torch.get_rng_state()
    check_network(model, TCDiffPP)
    assert torch.equal(before, torch.get_rng_state()) and model.training
    assert not any(part._forward_hooks for part in model.modules())


def test_extensions_need_a_class_that_takes_them():
    names = ["preconditioning"]
    assert build(Extended, TINY, names).extensions == tuple(names)
    check_network(build(Extended, TINY, names), TCDiffPP)
    with pytest.raises(
        ValueError, match=r"MeanFusion takes none; derive it from .*ExtendedTCDiffPP"
    ):
        build(MeanFusion, TINY, names)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (f"{HERE}:Mean", "must be derived from TCDiffPP or EDGE"),
        (f"{HERE}:MyLodge", "must be derived from TCDiffPP or EDGE"),
        (f"{HERE}:nobody", "has no 'nobody'"),
        ("GAN", "nor 'module:Class' of your own"),
    ],
)
def test_a_config_with_a_class_that_is_no_network(kind, words):
    with pytest.raises(ValueError, match=rf"a\.toml: .*{words}"):
        check_tables({"model": {"class": kind}, "train": {}}, "a.toml")


def test_sizes_are_those_of_the_paper_that_a_class_is_derived_from():
    check_tables({"model": {"class": f"{HERE}:MeanFusion", "fusion_hidden": 8}, "train": {}}, "a")
    with pytest.raises(ValueError, match="has no 'fusion_hidden'"):
        check_tables({"model": {"class": f"{HERE}:Solo", "fusion_hidden": 8}, "train": {}}, "a")


@pytest.fixture
def evil(tmp_path, monkeypatch):
    """A model folder beside a module that must not be imported."""
    (tmp_path / "evil_part.py").write_text("raise SystemExit('it ran')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    hub.save_model(TCDiffPP(TINY), tmp_path / "model")
    stored = json.loads((tmp_path / "model" / "config.json").read_text())
    stored["class"] = "evil_part:Model"
    (tmp_path / "model" / "config.json").write_text(json.dumps(stored))
    return tmp_path / "model"


def test_a_folder_cannot_have_its_class_imported(evil, capsys):
    with pytest.raises(ValueError, match="'evil_part:Model', code that does not come with"):
        hub.load(evil)
    assert main(["generate", "packaged", "--model", str(evil), "--out", "out"]) == 2
    assert "--own evil_part:Model" in capsys.readouterr().err
    # what is named is what is imported, whatever the folder says
    assert isinstance(hub.load(evil, own=TCDiffPP).model, TCDiffPP)
    assert "evil_part" not in sys.modules


def test_own_networks_are_saved_and_loaded(tmp_path):
    model = MeanFusion(TINY)
    hub.save_model(model, tmp_path, dtype=torch.float32)
    for own in (MeanFusion, f"{HERE}:MeanFusion"):
        again = hub.load(tmp_path, own=own).model
        assert type(again) is MeanFusion
        assert all(torch.equal(again.state_dict()[k], v) for k, v in model.state_dict().items())
    with pytest.raises(ValueError, match=r"part 'decoder.fusion_projection.back' does not fit"):
        hub.load(tmp_path, own=TCDiffPP)


def test_a_class_made_inside_a_function_cannot_be_found_again(tmp_path):
    class Inner(MeanFusion):
        pass

    with pytest.raises(ValueError, match="define it in a module"):
        hub.save_model(Inner(TINY), tmp_path)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("two_numbers", r"returned \(20, 151\)"),
        ("deaf_loss", "does not depend on the guess"),
        ("broken_loss", "own_loss='.*:broken_loss' fails: AttributeError: .*no_such_thing"),
    ],
)
def test_losses_that_are_none(name, words):
    model = TCDiffPP(TINY)
    x = torch.rand(1, 2, 20, 151, requires_grad=True)
    extensions = TrainingExtensions(own_loss=f"{HERE}:{name}")
    c = compare(x, x, x.detach(), model.normalizer)
    how = {"extensions": extensions, "reconstruction": "simple"}
    with pytest.raises(ValueError, match=words):
        extended_losses(c, five_losses, LossWeights().terms(), **how)


def test_a_sampler_must_return_what_it_was_given():
    x = torch.zeros(1, 2, 9, 4)
    options = SamplerOptions(cosine_abar(), f"{HERE}:longer", steps=3, eta=1.0)
    with pytest.raises(ValueError, match=r"returned \(1, 4, 9, 4\); it must be like x_t"):
        sample(lambda x_t, t: x, x.shape, options)
    with pytest.raises(ValueError, match=r"sampler='math:sqrt': .*called as ddim_step is"):
        sample(lambda x_t, t: x, x.shape, replace(options, sampler="math:sqrt"))
    with pytest.raises(ValueError, match="sampler='nowhere:f': module 'nowhere'"):
        TCDiffPPRequest(sampler="nowhere:f")


def test_metrics_that_fail_are_told_and_end_nothing():
    dance = choreograph(np.arange(0.2, 3, 0.5), dancers=2, seed=0)[0]
    names = [f"{HERE}:{name}" for name in ("frames", "nowhere", "endless")]
    report = evaluate_dances([dance, dance.frames(0, 40)], metrics=names, workers=1)
    assert report[names[0]].value == (dance.num_frames + 40) / 2
    assert "fails: IndexError" in report[names[1]].reason
    assert "must be a finite number" in report[names[2]].reason
    with pytest.raises(ValueError, match="form 'module:name'"):
        evaluate_dances([dance], metrics=["frames"])


def fails_inside(x_t, t, t_next, x0_hat, abar, **rest):
    return x_t + "noise"


def test_an_error_inside_of_a_sampler_is_the_samplers():
    x = torch.zeros(1, 2, 9, 4)
    options = SamplerOptions(cosine_abar(), f"{HERE}:fails_inside", steps=3, eta=1.0)
    with pytest.raises(TypeError, match="unsupported operand"):
        sample(lambda x_t, t: x, x.shape, options)
