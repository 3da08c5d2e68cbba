"""The curves of a training are the numbers of its files, and follow a run that goes on."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import dancediff as dd
from dancediff.viz import learning_curves as curves
from dancediff.viz.style import as_png

HEADER = "step,seconds,simple,total,lr,gradient,validation\n"


def write_log(folder, steps: int, **rows):
    lines = [
        f"{k},{k / 10:.1f},{1 / (k + 1):.6g},{2 / (k + 1):.6g},0.001,{k % 7},"
        + (f"{abs(k - 39) + 1}" if k % 20 == 19 else "")
        for k in range(steps)
    ]
    (folder / "losses.csv").write_text(HEADER + "".join(f"{line}\n" for line in lines))


@pytest.fixture
def run(tmp_path):
    write_log(tmp_path, 100)
    (tmp_path / "metrics.csv").write_text("step,FID_k,GMR\n50,9,4\n100,8,3\n")
    (tmp_path / "previews").mkdir()
    for step, width in ((50, 3), (100, 5)):
        figure = Figure(figsize=(width, 2), dpi=20)
        (tmp_path / "previews" / f"step_{step:06d}.png").write_bytes(as_png(figure))
    return tmp_path


def test_every_number_is_drawn(run):
    figure = dd.learning_curves(run).figure()
    losses, validation, speed, rate, fid, gmr, *empty, strip = figure.axes
    assert [line.get_label() for line in losses.lines] == ["simple", "total"]
    assert losses.get_yscale() == "log" and losses.get_title("left") == "After 100 steps"
    np.testing.assert_allclose(losses.lines[1].get_ydata(), 2 / np.arange(1, 101), rtol=1e-4)
    assert list(validation.lines[0].get_xdata()) == [20, 40, 60, 80, 100]
    assert validation.get_title("left") == "Best at 40: 1"
    assert speed.lines[0].get_ydata().max() == 6 and set(rate.lines[0].get_ydata()) == {0.001}
    assert list(fid.lines[0].get_ydata()) == [9, 8] and gmr.get_title("left") == "GMR"
    assert not any(ax.axison for ax in empty)
    assert strip.images[0].get_array().shape[:2] == (40, 100)  # the newest


def test_a_run_that_has_just_begun_is_drawn(tmp_path):
    (tmp_path / "losses.csv").write_text(HEADER + "0,0.5,3")
    figure = dd.learning_curves(tmp_path).figure()
    assert figure.axes[0].get_title("left") == "After 0 steps" and as_png(figure)
    write_log(tmp_path, 10)
    assert "No validation" in dd.learning_curves(tmp_path).figure().axes[1].get_title("left")


def test_names_of_losses_stand_beside_the_curves_and_one_step_is_a_dot(tmp_path):
    write_log(tmp_path, 1)
    figure = dd.learning_curves(tmp_path).figure()
    figure.draw_without_rendering()
    losses = figure.axes[0]
    assert losses.get_legend().get_window_extent().x0 >= losses.get_window_extent().x1
    assert losses.get_title("left") == "After 1 step"
    assert [line.get_marker() for line in losses.lines] == ["o", "o"]


def test_many_steps_are_averaged(tmp_path):
    write_log(tmp_path, 2000)
    line = dd.learning_curves(tmp_path).figure().axes[0].lines[1]
    assert len(line.get_xdata()) <= curves.POINTS
    assert line.get_ydata()[0] == pytest.approx(np.mean(2 / np.arange(1, 8)), rel=1e-4)


def test_stages_are_named_where_they_have_the_logs(run):
    for stage in ("local", "global"):
        (run / "lodge" / stage).mkdir(parents=True)
        write_log(run / "lodge" / stage, 3)
    with pytest.raises(ValueError, match="name one of its stages: global, local"):
        dd.learning_curves(run / "lodge")
    (run / "lodge" / "previews").mkdir()
    (run / "previews" / "step_000050.png").rename(run / "lodge/previews/step_000050.png")
    assert len(dd.learning_curves(run / "lodge" / "local").figure().axes) == 5


def test_the_picture_follows_a_run_and_can_be_stopped(run, monkeypatch):
    pytest.importorskip("ipywidgets")
    shown = dd.learning_curves(run, every=0.01)
    shown._make_box()
    first, drawn = shown.picture.value, []
    waited = iter([False, False, False])

    def wait(every):
        drawn.append(shown.picture.value)
        if len(drawn) == 2:
            write_log(run, 150)
        return next(waited, True)

    monkeypatch.setattr(shown.stopped, "wait", wait)
    shown.follow()
    assert drawn[0] == drawn[1] == first and drawn[2] == drawn[3] != first
    assert shown.button.disabled and "run this cell again" in shown.message.value


def test_a_quiet_run_is_left(run, monkeypatch):
    pytest.importorskip("ipywidgets")
    monkeypatch.setattr(curves, "QUIET", 0.05)
    shown = dd.learning_curves(run, every=0.01)
    shown._make_box()
    shown.follow()  # comes to an end
    assert shown.button.disabled


def test_an_error_is_said_and_looking_goes_on(run, monkeypatch):
    pytest.importorskip("ipywidgets")
    shown = dd.learning_curves(run, every=0.01)
    shown._make_box()
    strip, said = run / "previews" / "step_000100.png", []
    whole, first = strip.read_bytes(), shown.picture.value

    def wait(every):
        said.append(shown.message.value)
        if len(said) == 1:
            strip.write_bytes(whole[:50])  # as it is while it is being written
        if len(said) == 3:
            strip.write_bytes(whole)
            write_log(run, 150)
        return len(said) == 4

    monkeypatch.setattr(shown.stopped, "wait", wait)
    shown.follow()
    assert all("Error" in text for text in said[1:3]) and said[3].startswith("newest step 0 s")
    assert shown.picture.value != first and shown.message.value == curves.AGAIN


def test_a_folder_is_followed_by_one_thread(run, monkeypatch):
    """However often its cell is run, and one panel however often it is shown."""
    pytest.importorskip("ipywidgets")
    stills = []
    monkeypatch.setattr(curves, "show_with_still", lambda *_: stills.append(Still()) or stills[-1])
    first, second = (dd.learning_curves(run, every=0.05) for _ in range(2))
    first._ipython_display_()
    box, thread = first.box, first._thread
    first._ipython_display_()
    assert first.box is box and first._thread is thread and thread.is_alive()
    second._ipython_display_()
    thread.join(20)
    assert not thread.is_alive() and second._thread.is_alive()
    assert first.message.value == curves.AGAIN and first.button.disabled
    assert [still.updates for still in stills] == [1, 1, 0]
    first._ipython_display_()  # looks on
    second._thread.join(20)
    assert first._thread.is_alive() and not first.button.disabled
    first.button.click()
    first._thread.join(20)
    assert not first._thread.is_alive()


class Still:
    """In the place of what a notebook's display gives."""

    updates = 0

    def update(self, _):
        self.updates += 1
