"""A gallery shows every dance and every file that is none."""

import re
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest

from dancediff.cli import main
from dancediff.data.choreographer import choreograph
from dancediff.data.take import DanceTake
from dancediff.data.take_file import write_take
from dancediff.metrics.report import evaluate_dances
from dancediff.viz.gallery import save_gallery
from dancediff.viz.player import SHOWN


@pytest.fixture
def folder(tmp_path):
    for k in (1, 2):
        dance = choreograph(np.arange(0.2, 4, 0.5), dancers=k, seed=k)[0]
        dance.meta["note"] = "<script>"
        (tmp_path / "dances" / "sub").mkdir(parents=True, exist_ok=True)
        dance.save(tmp_path / "dances" / "sub" / f"<b>{k}.npz")
    (tmp_path / "dances" / "broken.npz").write_bytes(b"PK nonsense")
    return tmp_path / "dances"


def test_every_dance_and_every_failure_has_a_line(folder, tmp_path):
    made = save_gallery(folder, tmp_path / "out")
    assert made.dances == ["sub/<b>1.npz", "sub/<b>2.npz"]
    assert list(made.failed) == ["broken.npz"]
    text = made.index.read_text()
    assert text.count("<tr>") == 4 and "no dance: " in text  # the heading is one, too
    assert "{{" not in text
    assert "<b>1" not in text and "&lt;b&gt;1" in text
    assert sorted(p.name for p in (tmp_path / "out").glob("sub_*")) == [
        "sub_<b>1.npz.html",
        "sub_<b>2.npz.html",
    ]


def test_pages_have_names_of_their_own_and_links_that_lead_to_them(tmp_path):
    dance = choreograph(np.arange(0.2, 2, 0.5), dancers=1, seed=1)[0]
    for name in ("50% #1/a?.npz", "50% #1_a?.npz"):
        (tmp_path / "in" / name).parent.mkdir(parents=True, exist_ok=True)
        dance.save(tmp_path / "in" / name)
    text = save_gallery(tmp_path / "in", tmp_path / "out").index.read_text(encoding="utf-8")
    links = dict.fromkeys(re.findall(r'href="(.*?)"', text))
    pages = {path.name for path in (tmp_path / "out").iterdir()} - {"index.html"}
    assert pages == {"50% #1_a?.npz.html", "50% #1_a?.npz_2.html"}
    assert {unquote(urlsplit(link).path) for link in links} == pages


def test_beats_of_a_file_are_taken(tmp_path):
    beats = np.arange(0.2, 4, 0.5)
    dance = choreograph(beats, dancers=1, seed=1)[0]
    (tmp_path / "in").mkdir()
    with_beats = DanceTake("a", dance, beats=beats)
    write_take(tmp_path / "in" / "a.npz", with_beats)
    dance.save(tmp_path / "in" / "b.npz")
    text = save_gallery(tmp_path / "in", tmp_path / "out").index.read_text(encoding="utf-8")
    lines = re.findall(r"<tr><td><a.*?</tr>", text, re.DOTALL)
    place = SHOWN.index("BAS")
    shown = [re.findall(r'<td class="n".*?>(.*?)</td>', line)[place] for line in lines]
    assert shown[1] == "-"
    assert float(shown[0]) == pytest.approx(evaluate_dances(with_beats)["BAS"].value, abs=1e-3)


def test_a_gallery_in_its_own_folder_does_not_list_itself(folder):
    save_gallery(folder, folder / "gallery")
    assert len(save_gallery(folder, folder / "gallery").dances) == 2


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(ValueError, match="holds no dance"):
        save_gallery(tmp_path, tmp_path / "out")


def test_the_command_says_what_it_made(folder, capsys):
    assert main(["gallery", str(folder)]) == 0
    out = capsys.readouterr().out
    assert "2 dances" in out and "broken.npz" in out and "index.html" in out


def test_a_gallery_of_no_dance_is_no_success(tmp_path, capsys):
    (tmp_path / "broken.npz").write_bytes(b"PK nonsense")
    assert main(["gallery", str(tmp_path)]) == 2
    found = capsys.readouterr()
    assert "no dance: broken.npz" in found.out and "not one dance in" in found.err
