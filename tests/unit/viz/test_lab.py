"""Panels that dance: what their titles claim is so, and they report and stop."""

import inspect
import json
import re
from functools import partial

import numpy as np
import pytest
import torch

import dancediff as dd
from dancediff import hub
from dancediff.extensions.build import build
from dancediff.generation.pipeline import pipeline_of
from dancediff.generation.presets import PAPER
from dancediff.generation.request import REQUESTS
from dancediff.genre import GENRES
from dancediff.papers.lodge.cue_guidance import guided_steps
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.viz import lab, panels
from places import BOOKS
from tiny_lodge import tiny_lodge
from tiny_tcdiffpp import tiny_tcdiffpp


@pytest.fixture(scope="module")
def song():
    return dd.packaged_song()


@pytest.fixture(scope="module")
def model():
    torch.manual_seed(0)
    small = TCDiffPPConfig(d_model=32, num_layers=1, num_heads=2, ff_dim=32, max_dancers=3)
    return pipeline_of(build(TCDiffPP, small, ["preconditioning"]).eval())


@pytest.fixture(scope="module")
def lodge():
    return pipeline_of(tiny_lodge(frames=256))


def title(figure, ax=0):
    return figure.axes[ax].get_title("left")


def test_dance_panel(model, song):
    figure, dance, _ = lab.dance_panel(model, song, dancers=2, seconds=1.0, steps=2, seed=7)
    assert figure.get_suptitle().startswith("Seed 7, 2 steps: joints move at")
    assert (dance.num_dancers, dance.num_frames) == (2, 30)


def test_sampling_panel_shows_guesses_and_when_they_are_there(model, song):
    figure, dance, _ = lab.sampling_panel(model, song, steps=9, seconds=2.0, seed=1)
    assert [title(figure, k) for k in range(6)] == [f"step {k}" for k in (1, 3, 4, 6, 7, 9)]
    curve = figure.axes[6].lines[0].get_ydata()
    assert len(curve) == 9 and curve[-1] == 0 and curve[0] > 1
    step = int(title(figure, 6).split()[2])
    assert (curve[step - 1 :] < 5).all() and (step == 1 or curve[step - 2] >= 5)
    assert dance.num_frames == 60


def test_sampling_panel_of_one_step(model, song):
    figure, *_ = lab.sampling_panel(model, song, steps=1, seconds=1.0)
    assert len(figure.axes) == 2


def test_swap_panel_says_whether_they_obey(model, song):
    figure, dance, _ = lab.swap_panel(model, song, swap="201", steps=2, seconds=2.0)
    asked, got = title(figure, 1).split("asked ")[1].split(", got ")
    assert asked == "201" and dance.num_dancers == 3
    assert title(figure, 1).startswith("They obey") == (got == "201")
    assert sorted(got) == list("012")


def test_swap_panel_starts_where_it_is_told(model, song):
    start = [(-2.0, 0.5), (1.5, -0.5)]
    _, dance, _ = lab.swap_panel(model, song, swap="10", start=start, steps=8, seconds=2.0)
    np.testing.assert_allclose(dance.root[:, 0, ::2], start, atol=0.05)


def test_long_panel_measures_the_seams(model, song):
    figure, dance, _ = lab.long_panel(model, song, overlap=50, seconds=9.0, steps=2)
    assert dance.meta["seams"] and dance.meta["overlap"] == 50
    step = 100 * dance.joints().diff(dim=1).norm(dim=-1).amax()
    assert f"anywhere {step:.1f} cm" in title(figure)
    short, _, _ = lab.long_panel(model, song, seconds=3.0, steps=2)
    assert "one segment, no seam" in title(short)


def test_cue_panel_draws_what_is_held(lodge, song):
    figure, dance, _ = lab.cue_panel(lodge, song, soft=0.5, seconds=9.0, steps=6)
    ribbon = np.asarray(figure.axes[1].images[0].get_array())
    assert ribbon.shape == (6, 270)
    held = (ribbon == 1).any(1)
    times = dd.diffusion.samplers.sampling_times("dpm", 6, lodge.model.abar)
    assert held.sum() == guided_steps(times, 0.5) and held[: held.sum()].all()
    assert (ribbon == 2).any(1).all()
    assert "s = 0.5: BAS 0." in title(figure)
    assert dance.meta["soft"] == 0.5


def test_without_mirrored_cues_there_are_fewer(lodge, song):
    _, many = lab.cue_frames(lodge, song, 500, mirror=True, beat_align=True)
    _, few = lab.cue_frames(lodge, song, 500, mirror=False, beat_align=True)
    assert 0 < few.sum() < many.sum()


class Stop(Exception):
    pass


@pytest.mark.parametrize("name", ["dance", "sampling", "swap", "long"])
def test_every_panel_reports_and_can_be_stopped(name, model, song):
    panel, ticks = partial(getattr(lab, f"{name}_panel"), model, song, seconds=2.0, steps=3), []
    panel(report=lambda *tick: ticks.append(tick))
    assert ticks == [(1, 3), (2, 3), (3, 3)]

    def stop(done, total):
        raise Stop

    with pytest.raises(Stop):
        panel(report=stop)


def test_the_cue_panel_can_be_stopped(lodge, song):
    def stop(done, total):
        raise Stop

    with pytest.raises(Stop):
        lab.cue_panel(lodge, song, seconds=3.0, steps=2, report=stop)


@pytest.mark.parametrize("name", ["dance", "sampling", "swap", "long", "cue"])
def test_panels_have_no_defaults_of_their_own(name):
    """Those of `generate` count; what a panel shortens so that nobody waits is in its body."""
    names = {option for request in REQUESTS.values() for option in request.names()}
    parameters = inspect.signature(getattr(lab, f"{name}_panel")).parameters
    assert not (set(parameters) - {"swap"}) & names


def test_every_slider_of_an_option_marks_the_papers_value(model, lodge):
    models = {"tcdiffpp": model, "lodge": lodge}
    for family, preset in PAPER.items():
        for option, value in preset.items():
            if family in models and option not in ("genre", "energy"):  # see `style_controls`
                low_high = (0, 50) if type(value) in (int, float) else ()
                label = panels.option(models[family], option, *low_high).description
                said = f"{value:g}" if isinstance(value, float) else str(value)
                assert label.endswith(f"(paper: {said})"), label
    assert panels.option(lodge, "seed", 0, 9).description == "seed"
    steps = panels.option(models["tcdiffpp"], "steps", 1, 50, value=8)
    assert (steps.value, steps.min, steps.max) == (8, 1, 50)


def test_controls_for_genre_and_energy_are_those_of_the_models_parts(model, lodge):
    assert panels.style_controls(model) == {}
    (genre,) = panels.style_controls(lodge, genre="salsa").values()
    assert genre.value == "salsa" and genre.options[0] == "by tempo"
    assert genre.options[1:] == lodge.config.genres, "Lodge cannot dance without a genre"
    styled = tiny_tcdiffpp(["preconditioning", "genre_condition", "energy_condition"])
    controls = panels.style_controls(styled)
    assert list(controls) == ["genre", "energy"]
    assert controls["genre"].options == ("by tempo", *GENRES, "any")
    energy = controls["energy"]
    assert (energy.min, energy.value, energy.description.endswith("(paper: any)")) == (0, 1, True)
    song = hub.packaged_song()
    for control in controls["genre"].options:
        styled.resolve(song, genre=control, energy=energy.max)


def test_lessons_take_controls_of_options_from_the_request():
    names = "|".join(name for request in REQUESTS.values() for name in request.names())
    own = re.compile(rf"\b({names})=panels\.(slider|choice)\(")
    for path in sorted(BOOKS.glob("*.ipynb")):
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            source = "".join(cell["source"])
            if re.search(r"(dance|sampling|swap|long|cue)_panel, model", source):
                found = {match[1] for match in own.finditer(source)}
                assert found <= {"swap", "genre"}, f"{path.name}: {found}"
