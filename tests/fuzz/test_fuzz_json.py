"""Broken manifests, labels and lists: nothing but ValueError, no hang."""

import json
import random

import numpy as np
import pytest
from fuzzing import fuzz, num_inputs, put

from dancediff.data.aioz import aioz_jobs
from dancediff.data.aistpp import aistpp_jobs
from dancediff.data.cmu import cmu_jobs
from dancediff.data.finedance import _genre
from dancediff.data.prepared import FORMAT, PreparedData

NASTY = ["[]", "{}", "null", "true", "-1", "1e999", "NaN", '"', '"a"', "[[]]", "9" * 5000,
         "[" * 3000, '{"a":' * 3000, "\\u0000", "\\ud800", "é", "\x00", ",", ":", "}", "]",
         '"../../a"', "{}{}"]  # fmt: skip
MANIFEST = {
    "source": "mocap",
    "licence": "free",
    "salsa": {
        "fps_true": 60,
        "pairs": [
            {"take": 1, "a": "a.bvh", "b": "b.bvh", "split": "train", "spike_frames_a": [[1, 2]]},
            {"take": 2, "a": "c.bvh", "b": "d.bvh", "split": "val"},
        ],
    },
    "indian": {"fps_true": 120, "takes": [{"take": 4, "file": "e.bvh", "split": "train"}]},
}
LABEL = {"name": "A Song", "style1": "Modern", "style2": "Hiphop"}
VALUES = [None, True, -1, 1.5, "", "a", [], [1], {}, {"a": 1}, [[]], "é" * 10, 10**30]


ROW = {
    "name": "a", "file": "takes/a.npz", "kind": "real", "music": "none", "split": "train",
    "group": "a", "source": "s", "licence": "l", "dancers": 2, "frames": 30, "genre": None,
    "fps": 30.0, "songs": 0, "made_by": "0", "notes": {"spikes": [[1, 2]]},
}  # fmt: skip
INDEX = {
    "format": FORMAT,
    "fps": 30,
    "takes": [ROW, {**ROW, "name": "b", "file": "composed/b.npz", "split": "val", "group": "b"}],
    "skipped": [{"name": "c", "reason": "r"}],
}


def mutate_text(rng: random.Random, text: str) -> str:
    for _ in range(rng.randint(1, 3)):
        at, kind = rng.randrange(len(text) + 1), rng.randrange(4)
        if kind == 0:
            text = text[:at] + rng.choice(NASTY) + text[at + rng.randrange(2) :]
        elif kind == 1:
            text = text[:at] + chr(rng.randrange(32, 126)) + text[at + 1 :]
        elif kind == 2 and rng.random() < 0.3:
            text = text[:at]
        else:
            text = text[:at] + text[at + rng.randint(1, 12) :]
    return text


def mutate_value(rng: random.Random, value):
    """The value with one part, anywhere inside, replaced or taken away."""
    if rng.random() < 0.2 or not isinstance(value, dict | list) or not value:
        return rng.choice(VALUES)
    copy = value.copy()
    key = rng.choice(list(copy)) if isinstance(copy, dict) else rng.randrange(len(copy))
    if rng.random() < 0.2:
        del copy[key]
    else:
        copy[key] = mutate_value(rng, copy[key])
    return copy


def mutate(rng: random.Random, value) -> str:
    text = mutate_text if rng.random() < 0.5 else None
    return text(rng, json.dumps(value)) if text else json.dumps(mutate_value(rng, value))


def refused(read, value, path, record_property) -> float:
    """The share of mutations of a JSON file that is refused."""

    def read_it(given):
        put(path, given)
        read()

    rng = random.Random(0)
    out = fuzz(read_it, (mutate(rng, value) for _ in range(num_inputs())))
    record_property("trust", f"fuzz, {path.name}: {out}")
    return out.refused / out.tried


def test_the_manifest_of_cmu(tmp_path, record_property):
    path = tmp_path / "manifest.json"
    path.write_text(json.dumps(MANIFEST))
    assert len(cmu_jobs(tmp_path)) == 3
    assert 0.5 < refused(lambda: cmu_jobs(tmp_path), MANIFEST, path, record_property) < 0.95


def test_takes_of_a_broken_manifest(tmp_path):
    """What passes the manifest must still end in ValueError when the take is made."""
    rng, made = random.Random(1), 0
    for _ in range(num_inputs(3000)):
        put(tmp_path / "manifest.json", mutate(rng, MANIFEST))
        try:
            jobs = cmu_jobs(tmp_path)
        except ValueError:
            continue
        for job in jobs:
            with pytest.raises(ValueError, match=r"\w"):
                job.make()
            made += 1
    assert made > 1000


def test_the_index_of_prepared_data(tmp_path, record_property):
    path = tmp_path / "index.json"
    path.write_text(json.dumps(INDEX))
    assert len(PreparedData(tmp_path)) == 2
    share = refused(lambda: list(PreparedData(tmp_path)), INDEX, path, record_property)
    assert 0.5 < share < 0.98


def test_labels_of_finedance(tmp_path, record_property):
    path = tmp_path / "001.json"
    path.write_text(json.dumps(LABEL))
    assert _genre(path) == ("Hiphop", "Hiphop")
    assert 0.3 < refused(lambda: _genre(path), LABEL, path, record_property) < 0.95


@pytest.mark.parametrize("reader", ["aioz", "aistpp"])
def test_lists_of_takes(tmp_path, reader, record_property):
    rng = random.Random(2)
    name = "gBR_sBM_cAll_d04_mBR0_ch01"
    (tmp_path / "motions").mkdir()
    (tmp_path / "motions_smpl").mkdir()
    (tmp_path / "motions_smpl" / "a_1_2_3.pkl").touch()
    names = {"aioz": "train_split_sequence_names.txt", "aistpp": "crossmodal_train.txt"}
    jobs = {"aioz": aioz_jobs, "aistpp": aistpp_jobs}[reader]

    def read(raw):
        put(tmp_path / names[reader], raw)
        junk = np.random.default_rng(0).bytes(9) if rng.random() < 0.1 else b""
        put(tmp_path / "labels.csv", junk + b"name,genre,style\n" + raw.replace(b"\n", b",a,b\n"))
        jobs(tmp_path)

    texts = (mutate_text(rng, f"{name}\n{name[:-1]}2\r\n") for _ in range(num_inputs()))
    ends = [b"", b"\xff", b"\xef\xbb\xbf"]
    out = fuzz(read, (text.encode("utf-8") + rng.choice(ends) for text in texts))
    record_property("trust", f"fuzz, {names[reader]}: {out}")
    assert out.refused > 0.2 * out.tried
    assert out.read > 0.01 * out.tried
