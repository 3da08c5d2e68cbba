import json

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from dancediff import hub
from dancediff.extensions.build import build
from dancediff.generation.pipeline import usable_device
from dancediff.motion.representation import Normalizer
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig


@pytest.fixture
def model():
    torch.manual_seed(1)
    tiny = TCDiffPPConfig(d_model=16, num_layers=1, num_heads=2, ff_dim=32, fusion_hidden=32)
    net = TCDiffPP(tiny)
    net.normalizer = Normalizer(-3.3 * torch.ones(151), 1.7 * torch.ones(151))
    return net


def test_round_trip(model, tmp_path):
    hub.save_model(model, tmp_path / "tiny", card="hello")
    again = hub.load(tmp_path / "tiny")
    assert again.config == model.config and again.name == "tiny"
    again = again.model
    assert not again.training
    for name, value in model.state_dict().items():
        assert torch.allclose(again.state_dict()[name], value, rtol=1e-3, atol=1e-4), name
    assert torch.equal(again.normalizer.low, model.normalizer.low)  # never rounded to fp16
    assert sorted(p.name for p in (tmp_path / "tiny").iterdir()) == [
        *["card.md", "config.json", "model.safetensors"]
    ]
    with safe_open(tmp_path / "tiny" / "model.safetensors", "pt") as file:
        kinds = {file.get_tensor(k).dtype for k in file.keys() if k.startswith("decoder")}
    assert kinds == {torch.float16}


def test_loading_leaves_the_draws_of_the_caller_alone(model, tmp_path):
    hub.save_model(model, tmp_path / "tiny")
    before = torch.random.get_rng_state()
    hub.load(tmp_path / "tiny")
    assert torch.equal(torch.random.get_rng_state(), before)


def test_sizes_may_be_numbers_of_numpy(tmp_path):
    sizes = {name: np.int64(16) for name in ("d_model", "ff_dim", "fusion_hidden")}
    config = TCDiffPPConfig(num_layers=1, dropout=np.float32(0.5), **sizes)
    hub.save_model(TCDiffPP(config), tmp_path / "tiny")
    assert hub.load(tmp_path / "tiny").config == config


def test_a_folder_of_a_newer_version_is_told(model, tmp_path):
    hub.save_model(model, tmp_path)
    hub.load(tmp_path)  # of this one, without a word
    stored = json.loads((tmp_path / "config.json").read_text())
    stored["dancediff"] = "99.0"
    (tmp_path / "config.json").write_text(json.dumps(stored))
    with pytest.warns(UserWarning, match=r"is of dancediff 99\.0, this is .*; update it"):
        hub.load(tmp_path)


def test_a_folder_of_before_extensions_were_named_is_told(model, tmp_path):
    hub.save_model(model, tmp_path)
    stored = json.loads((tmp_path / "config.json").read_text())
    del stored["extensions"]
    (tmp_path / "config.json").write_text(json.dumps(stored))
    with pytest.raises(ValueError, match="names no extensions: an older dancediff wrote it"):
        hub.load(tmp_path)


def test_extensions_are_kept(tmp_path):
    config = TCDiffPPConfig(d_model=16, num_layers=1, num_heads=2, ff_dim=32, fusion_hidden=32)
    net = build(TCDiffPP, config, ["ssd", "preconditioning"])
    hub.save_model(net, tmp_path, dtype=torch.float32)
    again = hub.load(tmp_path).model
    assert again.extensions == ("ssd", "preconditioning")
    assert all(torch.equal(again.state_dict()[k], v) for k, v in net.state_dict().items())


@pytest.mark.parametrize("name", ["nobody", None, 3])
def test_unknown_name_lists_what_there_is(name):
    with pytest.raises(ValueError, match=rf"{name!r}.*choose a packaged one \(.*tcdiffpp"):
        hub.load(name)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"class": "Evil"}, "'Evil' is not one of TCDiffPP"),
        (
            {"extensions": ["wings"]},
            "extensions: 'wings' is not one of those of TCDiffPP: .*precond",
        ),
        ({"extensions": ["foot_cues"]}, "'foot_cues' needs 'preconditioning'"),
        ({"extensions": "ssd"}, "extensions='ssd' should be a list of names"),
        ({"config": {"without": ["lstm"]}}, "without: 'lstm' is not one of"),
        ({"config": []}, "config is a list"),
        ({"config": {"d_model": 10**9}}, "d_model=1000000000"),
        ({"config": {"d_model": "16"}}, "should be int"),
        ({"config": {"colour": 1}}, "colour"),
        ({"config": {"d_model": 32}}, r"has shape \(5, 16\) in the weights, \(5, 32\)"),
        ({"config": {"num_layers": 2}}, "has shape None in the weights"),
        ({"config": {"num_layers": 10**4}}, r"must lie in 1 \.\.\. 64"),
        # would take 100 GB, if it were made before it is compared with the file
        ({"config": {"d_model": 4096, "num_layers": 64}}, "has shape"),
    ],
)
def test_bad_folders_are_refused(model, tmp_path, change, message):
    hub.save_model(model, tmp_path)
    path = tmp_path / "config.json"
    stored = json.loads(path.read_text())
    for key, value in change.items():
        stored[key] = stored[key] | value if isinstance(value, dict) else value
    path.write_text(json.dumps(stored))
    with pytest.raises(ValueError, match=message):
        hub.load(tmp_path)


def test_damaged_weights_are_refused(model, tmp_path):
    hub.save_model(model, tmp_path)
    weights = tmp_path / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:1000])
    with pytest.raises(ValueError, match="cannot be read"):
        hub.load(tmp_path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("[1]", "holds list, not a table of names"),
        ("{", r"is no JSON \(.*line 1 column 2"),
        ('{"class": "TCDiffPP", "extensions": []}', "names no config"),
        ('{"config": {}}', "names no class"),
        ("\x00", "is no JSON"),
    ],
)
def test_a_config_that_is_no_table_is_refused(model, tmp_path, text, said):
    hub.save_model(model, tmp_path)
    (tmp_path / "config.json").write_text(text)
    with pytest.raises(ValueError, match=f"cannot be read: config.json {said}"):
        hub.load(tmp_path)


def test_weights_that_are_not_finite_are_refused(model, tmp_path):
    hub.save_model(model, tmp_path, dtype=torch.float32)
    weights = load_file(tmp_path / "model.safetensors")
    weights["normalizer.low"][3] = float("nan")
    save_file(weights, tmp_path / "model.safetensors")
    with pytest.raises(ValueError, match=r"normalizer\.low holds values"):
        hub.load(tmp_path)


def test_weights_too_large_for_half_precision_are_not_written(model, tmp_path):
    with torch.no_grad():
        next(model.decoder.parameters()).fill_(1e6)
    with pytest.raises(ValueError, match=r"not finite in torch\.float16"):
        hub.save_model(model, tmp_path / "new")
    assert not (tmp_path / "new").exists()
    hub.save_model(model, tmp_path / "new", dtype=torch.float32)
    assert hub.load(tmp_path / "new").config == model.config


def test_a_failed_save_leaves_the_old_model(model, tmp_path, monkeypatch):
    hub.save_model(model, tmp_path, card="old")
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}

    def fail(tensors, path, metadata):
        path.write_bytes(b"half")
        raise OSError("disk full")

    monkeypatch.setattr("safetensors.torch.save_file", fail)
    with pytest.raises(OSError, match="disk full"):
        hub.save_model(model, tmp_path, card="new")
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_unknown_device_is_refused(model, tmp_path):
    hub.save_model(model, tmp_path)
    with pytest.raises(ValueError, match="device='nowhere' cannot be used"):
        hub.load(tmp_path, device="nowhere")


def test_packaged_song_can_be_danced_to():
    song = hub.packaged_song()
    truth = json.loads((hub.ASSETS / "songs" / "studio_floor.json").read_text())
    assert 28 < song.duration < 33 and song.tempo == pytest.approx(truth["tempo"], rel=0.02)
    assert (hub.ASSETS / "songs" / "studio_floor.ogg").stat().st_size < 600_000


def test_packaged_model_is_small_and_has_a_card():
    folder = hub.ASSETS / "models" / "tcdiffpp"
    assert "tcdiffpp" in hub.packaged_models()
    assert (folder / "model.safetensors").stat().st_size < 16_000_000
    card = (folder / "card.md").read_text(encoding="utf-8")
    for word in ("synthetic", "steps", "seed", "time"):
        assert word in card.lower()


def test_the_folder_of_a_training_leads_to_its_model(model, tmp_path):
    hub.save_model(model, tmp_path / "try" / "model")
    with pytest.raises(ValueError, match=r"did you mean '.*try.model'\?"):
        hub.load(tmp_path / "try")


@pytest.mark.parametrize("device", ["cuda:99", torch.device("cuda:99")])
def test_a_device_that_is_not_here_is_called_by_its_name(device, model, tmp_path):
    hub.save_model(model, tmp_path / "tiny")
    words = "^device='cuda:99' cannot be used here: .*; choose 'cpu'$"
    with pytest.raises(ValueError, match=f"(?s){words}"):
        usable_device(device)
    with pytest.raises(ValueError, match=f"(?s){words}"):
        hub.load(tmp_path / "tiny", device=device)
