"""`dancediff doctor`: it tries things, says how to mend them, and fails if nobody could dance."""

import json

import pytest

from dancediff import hub
from dancediff.cli import doctor, main
from dancediff.music.song import Music


def test_all_is_well(capsys):
    assert main(["doctor"]) == 0
    text = capsys.readouterr().out
    assert "cores" in text and "dancediff 0." in text
    assert text.count("✓") == len(doctor.CHECKS) and "✗" not in text


def test_a_missing_extra_is_named_with_its_fix(capsys, monkeypatch):
    find = doctor.importlib.util.find_spec
    monkeypatch.setattr(
        doctor.importlib.util, "find_spec", lambda name: None if name == "nbval" else find(name)
    )
    assert main(["doctor"]) == 0  # one may dance without
    assert '✗ lessons: ImportError: nbval missing; pip install "dancediff[notebooks]"' in (
        capsys.readouterr().out
    )


@pytest.mark.parametrize("what", ["sound", "models"])
def test_what_every_dance_needs_must_work(what, capsys, monkeypatch):
    def broken(*_, **__):
        raise ValueError("half of it is gone")

    monkeypatch.setattr(*((Music, "load") if what == "sound" else (hub, "load")), broken)
    assert main(["doctor", "--json"]) != 0
    said = capsys.readouterr()
    facts = json.loads(said.out)[what]
    assert not facts["works"] and doctor.SETUP in facts["found"]
    assert what in said.err
