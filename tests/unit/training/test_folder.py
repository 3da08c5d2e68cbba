"""Folders of trainings: each kind of model leaves those of the others alone."""

import pytest
from safetensors.torch import load_file

from dancediff import hub
from dancediff.cli import main
from dancediff.papers.edge.model import EDGE
from dancediff.papers.tcdiffpp.model import TCDiffPP
from dancediff.training.checkpoint import NAME
from dancediff.training.folder import check_out
from dancediff.training.lodge import STAGES, Lodge
from dancediff.training.run import train_from_config
from tiny_lodge import tiny_lodge
from tiny_tcdiffpp import tiny_tcdiffpp

DATA = "[data]\nsongs = 1\nheld_out = 1\nseconds = 6.0\nvaried = false\nworkers = 1\n"
SMALL = "d_model = 16\nnum_heads = 2\nnum_layers = 1\nff_dim = 32\n"
TRAIN = "[train]\nsteps = 1\nwarmup = 0\nevaluate_every = 1\n"
KINDS = {
    "TCDiffPP": "fusion_hidden = 32\nnum_frames = 30\n",
    "FACT": "",
    "Lodge": "",
    "Bailando": "",
}


def config_of(kind, folder):
    path = folder / f"{kind}.toml"
    small = "" if kind == "Lodge" else SMALL
    path.write_text(f'{DATA}[model]\nclass = "{kind}"\n{small}{KINDS[kind]}{TRAIN}')
    return path


def left(*folders):
    for folder in folders:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / NAME).touch()


@pytest.mark.parametrize("resume", [False, True])
@pytest.mark.parametrize(
    ("there", "kind"),
    [
        (".", "Lodge"),
        (".", "FACT"),
        ("fine_tune", "TCDiffPP"),
        ("units", "TCDiffPP"),
        ("train", "Lodge"),
        ("global", "Bailando"),
    ],
)
def test_a_folder_with_a_training_of_another_kind_is_left_alone(tmp_path, there, kind, resume):
    """Each kind looked for checkpoints of its own only, and trained beside or over the others."""
    out = tmp_path / "run"
    left(out / there)
    with pytest.raises(ValueError, match=r"of another kind of model, .* \(overwrite\)"):
        train_from_config(config_of(kind, tmp_path), out, takes=[], resume=resume)
    assert [path.name for path in out.rglob("*") if path.is_file()] == [NAME]


def test_branches_and_other_folders_beside_are_no_training_of_another_kind(tmp_path):
    left(tmp_path / "15min", tmp_path / "4000windows", tmp_path / "tcdiffpp")
    stages = [tmp_path / stage for stage in Lodge.stages]
    for kind, trained in ((TCDiffPP, [tmp_path]), (Lodge, stages)):
        check_out(tmp_path, kind, trained, resume=False, overwrite=False)
    assert tuple(STAGES) == Lodge.stages


def test_a_training_does_not_go_on_beside_a_model_of_another_class(tmp_path):
    left(tmp_path)
    said = {"resume": True, "overwrite": False}
    hub.save_model(tiny_tcdiffpp().model, tmp_path / "model")
    check_out(tmp_path, TCDiffPP, [tmp_path], **said)
    with pytest.raises(ValueError, match="is a TCDiffPP, but the config trains a EDGE"):
        check_out(tmp_path, EDGE, [tmp_path], **said)
    (tmp_path / "model" / "config.json").write_text("{")
    check_out(tmp_path, EDGE, [tmp_path], **said)


@pytest.mark.parametrize("kinds", [("TCDiffPP", "FACT"), ("FACT", "TCDiffPP")])
def test_overwritten_by_another_kind_it_is_a_whole_training_of_that(tmp_path, kinds):
    """Checkpoints and losses of the old kind stayed, to be gone on with and shown."""
    out = tmp_path / "run"
    for kind in kinds:
        config = config_of(kind, tmp_path)
        assert main(["train", str(config), "--out", str(out), "--overwrite"]) == 0
        assert type(hub.load(out / "model").model).__name__.endswith(kind)
    assert (out / "train").exists() and (out / NAME).exists() == (kinds[1] == "TCDiffPP")
    assert (out / "losses.csv").exists() == (out / "best").exists() == (kinds[1] == "TCDiffPP")
    assert (out / "train" / NAME).exists() == (kinds[1] == "FACT")
    again = ["train", str(config), "--out", str(out), "--resume"]
    assert main(again) == 0


def test_a_failed_training_that_would_overwrite_leaves_the_other_kind(tmp_path):
    left(tmp_path / "run")
    args = ["train", str(config_of("FACT", tmp_path)), "--out", str(tmp_path / "run")]
    assert main([*args, "--overwrite", "--data", str(tmp_path / "nowhere")]) == 2
    assert (tmp_path / "run" / NAME).exists()


def test_a_saved_model_has_no_weights_of_another_kind_beside_it(tmp_path):
    for model, names in (
        (tiny_tcdiffpp().model, {"model"}),
        (tiny_lodge(), {"global", "local"}),
        (tiny_tcdiffpp().model, {"model"}),
    ):
        folder = hub.save_model(model, tmp_path)
        assert {path.stem for path in folder.glob("*.safetensors")} == names
        assert all(load_file(path) for path in folder.glob("*.safetensors"))
        assert type(hub.load(folder).model) is type(model)
