import itertools

import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from dancediff.data.choreographer import choreograph
from dancediff.diffusion.schedule import cosine_abar
from dancediff.metrics.drift import Drift
from dancediff.metrics.posture import POSTURE
from dancediff.motion.motion import Motion
from dancediff.music.features import LATE
from dancediff.music.song import Music
from dancediff.viz import body, plots, source_and_result
from dancediff.viz.body import body_points
from dancediff.viz.palette import DANCER_COLORS, dancer_color, rgb
from dancediff.viz.projection import Camera, follow
from dancediff.viz.source_and_result import draw_source_and_result
from dancediff.viz.style import as_png


@pytest.fixture(scope="module")
def dance():
    return choreograph(np.arange(0.2, 6, 0.5), dancers=3, seed=1)[0]


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def still(n=1, f=3, x=0.0):
    root = torch.tensor([x, 0.965, 0.0]).repeat(n, f, 1)
    return Motion(torch.eye(3).expand(n, f, 24, 3, 3), root)


def click_song(seconds=6):
    audio = np.zeros(44100 * seconds, dtype=np.float32)
    for beat in np.arange(0.25, seconds, 0.5):
        start = int(beat * 44100)
        audio[start : start + 400] = np.hanning(400)
    return Music(audio, 44100, "clicks")


def test_a_name_is_no_formula(tmp_path):
    """Matplotlib would read what stands between two "$" as TeX, and refuse this."""
    song = Music(click_song(2).audio, 44100, r"$\frac$")
    assert plots.save_filmstrip(still(f=60), tmp_path / "a.png", song).stat().st_size > 1000
    bones = [(still().joints()[0], still().skeleton.parents, 30.0)]
    draw_source_and_result(song.name.replace("\\", ""), bones, still(), tmp_path)
    draw_source_and_result("$^$", bones, still(), tmp_path)
    assert (tmp_path / "$^$.png").exists()
    name, drift = r"$\frac$", Drift(np.ones((len(POSTURE), 2)), np.arange(2.0))
    ax = plots.plot_noise_filmstrip([still(), still()], [name, name], title=name)
    assert as_png(ax.figure) and as_png(plots.plot_drift({name: drift, "b": drift}).figure)


def test_rows_of_a_strip_are_those_that_its_axes_have_room_for(dance):
    _, axes = plt.subplots(2, 1, figsize=(7, 6), height_ratios=[1, 4])
    flat, high = (plots.plot_filmstrip(dance, ax=ax, count=4) for ax in axes)
    assert len({image.get_extent()[2] for image in flat.images}) == 1
    assert len({image.get_extent()[2] for image in high.images}) == 2
    high.apply_aspect()
    low, top = ({image.get_extent()[k] for image in high.images} for k in (2, 3))
    gap = high.transData.transform([(0, max(low)), (0, min(top))])[:, 1]
    assert gap[0] - gap[1] > 9 / 72 * high.figure.dpi  # a line of text, between the rows


def test_discs_on_the_floor_hide_each_other_with_their_numbers():
    ax = plots.plot_floor_paths(still(3))
    discs = [line.get_zorder() for line in ax.lines if line.get_markersize() == 13]
    assert discs == sorted(set(discs)) == [text.get_zorder() for text in ax.texts]


def test_a_wide_floor_has_few_lines():
    far = torch.zeros(1, 3, 3)
    far[0, :, 0] = torch.tensor([0.0, 30, 600])
    ax = plots.plot_floor_paths(Motion(torch.eye(3).expand(1, 3, 24, 3, 3), far))
    assert len(ax.get_xticks()) < 12 and ax.get_xlim()[0] < -30  # discs are whole


def test_poses_of_one_dancer_have_one_colour():
    points, camera = body_points(still(3))[:, 0], Camera((0, 1, 5), (0, 1, 0), (90, 90), 100)
    colors = {tuple(c) for _, c in body.dancer_shapes(points, camera, dancer=1)}
    assert colors == {tuple(c) for _, c in body.dancer_shapes(points[:1], camera, dancer=1)}
    assert rgb(dancer_color(1)) in {c[:3] for c in colors}


def test_source_and_result_are_drawn_at_one_scale(dance, tmp_path, monkeypatch):
    shown = []
    monkeypatch.setattr(
        source_and_result, "save_figure", lambda figure, *a, **k: shown.append(figure)
    )
    bones = [(joints, dance.skeleton.parents, dance.fps) for joints in dance.joints()]
    draw_source_and_result("trio", bones, dance, tmp_path)
    wide = {round(float(np.ptp(ax.get_xlim())), 4) for ax in shown[0].axes}
    assert len(wide) == 1 and len({ax.get_ylim() for ax in shown[0].axes}) == 1


def test_dancers_stay_apart_in_greyscale():
    grey = [np.dot(rgb(c), (0.2126, 0.7152, 0.0722)) for c in DANCER_COLORS]
    neighbours = np.abs(np.diff(grey[:5]))
    assert neighbours.min() > 0.07
    assert len(set(DANCER_COLORS)) == len(DANCER_COLORS) >= 5


def test_camera_sees_its_target_in_the_middle_and_right_to_the_right():
    camera = Camera(eye=(1, 3, 8), target=(1, 1, 0), size=(400, 300), focal=300)
    xy, scale = camera.project([[1, 1, 0], [2, 1, 0], [1, 2, 0], [1, 1, 2]])
    np.testing.assert_allclose(xy[0], [200, 150])
    assert xy[1, 0] > xy[0, 0] and xy[1, 1] == pytest.approx(150)
    assert xy[2, 1] > xy[0, 1] and xy[2, 0] == pytest.approx(200)
    assert scale[3] > scale[0]  # nearer is larger


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.sampled_from([(160, 90), (90, 160), (100, 100)]))
def test_follow_never_loses_a_dancer(seed, size):
    rng = np.random.default_rng(seed)
    walk = rng.normal(0, 0.1, (2, 40, 1, 3)).cumsum(1)
    joints = walk * (1, 0, 1) + rng.uniform(0, 1.8, (2, 40, 24, 3))
    for f, camera in enumerate(follow(joints, size)):
        xy, _ = camera.project(joints[:, f])
        assert (xy >= 0).all() and (xy <= np.array(size)).all()


def test_follow_glides():
    dance = choreograph(np.arange(0.2, 12, 0.5), dancers=2, seed=3)[0]
    eyes = np.array([c.eye for c in follow(dance.joints().numpy(), (160, 90))])
    assert np.linalg.norm(np.diff(eyes, axis=0), axis=1).max() < 0.06  # metres a frame


def test_body_points_start_with_the_joints(dance):
    points = body.body_points(dance)
    np.testing.assert_allclose(points[:, :, :24], dance.joints().numpy(), atol=1e-6)
    rest = body.body_points(still())[0, 0]
    assert rest[body.FACE, 2] > rest[body.SKULL, 2]  # the face looks forward
    assert 0 < rest[body.LHEEL, 1] < rest[7, 1]  # the heel is below the ankle, on the floor


def test_near_dancer_is_drawn_over_the_far_one():
    pair = still(2)
    pair.root[1, :, 2] = 2.0  # nearer to the audience
    points = body.body_points(pair)[:, 0]
    camera = follow(points[:, None], (160, 90))[0]
    colors = [c for _, c in body.dancer_shapes(points, camera)]
    last = [max(i for i, c in enumerate(colors) if _is_tone(c, dancer_color(k))) for k in (0, 1)]
    assert last[0] < last[1]


def _is_tone(color, of) -> bool:
    """The colour itself or a darker tone of it."""
    a, b = np.array(color[:3]), np.array(to_rgb(of))
    return np.linalg.norm(a - b) < 0.05


def test_lifted_foot_has_a_fainter_shadow():
    points = body.body_points(still())[:, 0]
    camera = follow(points[:, None], (160, 90))[0]

    def darkest(p):
        return sum(color[3] for _, color in body.shadow_shapes(p, camera))

    lifted = points.copy()
    lifted[:, 10, 1] += 0.3
    assert darkest(lifted) < darkest(points)


def texts(ax) -> list[str]:
    return [text.get_text() for text in ax.texts]


def test_filmstrip_has_moments_in_rows(dance):
    ax = plots.plot_filmstrip(dance, count=6, title="Hello")
    assert ax.get_title("left") == "Hello"
    assert len(ax.images) == 6 == sum(name.endswith(" s") for name in texts(ax))
    lower_left = {tuple(image.get_extent()[::2]) for image in ax.images}
    assert len(lower_left) == 6
    for image in ax.images:
        left, right, low, high = image.get_extent()
        assert ax.get_xlim()[0] <= left < right <= ax.get_xlim()[1] + 1e-6
        assert ax.get_ylim()[0] <= low < high < ax.get_ylim()[1]  # and a line of text above


def test_filmstrip_names_the_beats_of_the_song(dance):
    assert any("beat" in name for name in texts(plots.plot_filmstrip(dance, song=click_song())))
    with pytest.raises(ValueError, match="song is a list; give a Music or a path"):
        plots.plot_filmstrip(dance, song=[0.5, 1.0])


def test_filmstrip_page_has_moments_floor_and_feet(dance):
    figure = plots.filmstrip_page(dance, count=6, title="Hello")
    assert isinstance(figure, Figure)
    assert figure.get_suptitle() == "Hello"
    strip, floor, feet = figure.axes
    assert len(strip.images) == 6
    assert floor.get_title("left") == plots.farthest(dance)
    standing = dance.contacts().reshape(dance.num_dancers, -1, 2, 2).amax(2).mean().item()
    assert feet.get_title("left") == f"Feet stand {standing:.0%} of the time"
    assert "clicks" in plots.filmstrip_page(dance, count=1, song=click_song()).get_suptitle()


@pytest.mark.parametrize("draw", [plots.plot_filmstrip, plots.filmstrip_page])
@pytest.mark.parametrize("count", [0, 25])
def test_filmstrip_refuses_a_silly_count(dance, draw, count):
    with pytest.raises(ValueError, match=f"count={count}"):
        draw(dance, count=count)


@pytest.mark.parametrize("frames", [1, 2, 5])
def test_filmstrip_of_a_dance_shorter_than_the_strip(frames):
    assert len(plots.plot_filmstrip(still(2, frames)).images) == 8


def test_moments_stay_in_order_and_apart():
    beats = np.arange(0, 600, 15)
    chosen = plots.moments(600, 8, beats)
    assert all(b > a for a, b in itertools.pairwise(chosen))
    assert set(chosen) <= set(beats.tolist())


def test_save_filmstrip_writes_a_png_and_nothing_else(dance, tmp_path):
    path = dance.save(tmp_path / "strip.png")
    assert path.read_bytes().startswith(b"\x89PNG")
    assert [p.name for p in tmp_path.iterdir()] == ["strip.png"]


def test_a_failed_filmstrip_leaves_the_old_file(dance, tmp_path, monkeypatch):
    path = tmp_path / "strip.png"
    path.write_text("old")

    def fail(*_, **__):
        raise RuntimeError("no ink")

    monkeypatch.setattr(Figure, "savefig", fail)
    with pytest.raises(RuntimeError, match="no ink"):
        dance.save(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_floor_paths_have_the_dancers_colours(dance):
    ax = plots.plot_floor_paths(dance)
    lines = [line for line in ax.lines if len(line.get_xdata()) == dance.num_frames]
    assert [line.get_color() for line in lines] == list(DANCER_COLORS[:3])
    np.testing.assert_allclose(lines[1].get_xdata(), dance.root[1, :, 0])
    np.testing.assert_allclose(lines[1].get_ydata(), dance.root[1, :, 2])
    low, high = ax.get_ylim()
    assert low > high  # the audience sits below: z grows downwards


def test_dancers_are_numbered_as_swap_counts_them(dance):
    """From 0, in every still picture."""
    numbers = ["0", "1", "2"]
    points = body_points(dance)
    camera = follow(points[:, :1], (160, 90))[0]
    moment, paths = plots.plot_moment(points[:, 0], camera), plots.plot_floor_paths(dance)
    for ax in (moment, paths):
        assert [text.get_text() for text in ax.texts] == numbers
    lanes = plots.plot_contact_strip(dance).get_yticklabels()
    assert [label.get_text().strip() for label in lanes] == numbers


def test_contact_strip_is_dark_where_the_foot_stands():
    motion = still(1, 4)
    motion.contact = torch.tensor([[[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 0]]])
    left, right = (
        image.get_array()[0].mean(-1) for image in plots.plot_contact_strip(motion).images
    )
    assert (left[[0, 2]] < 0.6).all() and (left[[1, 3]] == 1).all()
    assert right[1] < 0.6 and (right[[0, 2, 3]] == 1).all()


def test_contact_strip_labels_a_motion_without_contacts():
    motion = still(1, 4)
    motion.root[..., 1] = 3.0  # in the air
    assert all((image.get_array() == 1).all() for image in plots.plot_contact_strip(motion).images)


def test_features_have_four_groups_and_the_sound():
    song = click_song()
    top = plots.plot_features(song.features(), song=song, title="Clicks")
    assert top.get_title("left") == "Clicks"
    onset, mfcc, chroma = top.child_axes[1:]
    assert len(onset.collections) == 1
    assert mfcc.images[0].get_array().shape == (20, song.num_frames)
    assert chroma.images[0].get_array().shape == (12, song.num_frames)


def test_beats_are_lines_and_truth_is_dots():
    M = torch.zeros(60, 35)
    M[[10, 40], 34] = 1
    ax = plots.plot_beats(M, truth=[0.5])
    at = [segment[0, 0] for segment in ax.collections[1].get_segments()]
    assert at == pytest.approx(
        [10 / 30 - LATE, 40 / 30 - LATE]
    )  # as the true ones: when they sound
    assert ax.lines[0].get_xdata().tolist() == [0.5]


def test_skeleton_numbers_every_joint():
    ax = plots.plot_skeleton()
    assert [text.get_text() for text in ax.texts] == [str(j) for j in range(24)]


def test_barcode_shows_every_feature(dance):
    ax = plots.plot_barcode(dance.features()[0].requires_grad_())  # as a guess has it
    assert ax.images[0].get_array().shape == (151, dance.num_frames)


def test_schedule_curves_add_up():
    ax = plots.plot_schedule(cosine_abar(100), t=50)
    signal, noise = (line.get_ydata() for line in ax.lines[:2])
    np.testing.assert_allclose(signal**2 + noise**2, 1)


def test_noise_filmstrip_wants_a_label_each(dance):
    assert texts(plots.plot_noise_filmstrip([dance, dance], ["a", "b"])) == ["a", "b"]
    with pytest.raises(ValueError, match="labels"):
        plots.plot_noise_filmstrip([dance], ["a", "b"])


def test_every_plot_draws_on_the_axes_it_is_given(dance):
    M = click_song().features()
    points = body.body_points(dance)
    wanted = {
        "plot_barcode": [dance.features()[0]],
        "plot_beats": [M],
        "plot_contact_strip": [dance],
        "plot_drift": [Drift(np.ones((len(POSTURE), 4)), np.arange(4) * 5.0)],
        "plot_energy": [dance],
        "plot_features": [M],
        "plot_filmstrip": [dance],
        "plot_floor_paths": [dance],
        "plot_lanes": [dance],
        "plot_moment": [points[:, 0], follow(points[:, :1], (160, 90))[0]],
        "plot_noise_filmstrip": [[dance], ["a"]],
        "plot_schedule": [cosine_abar(100)],
        "plot_skeleton": [],
    }
    assert sorted(wanted) == [name for name in plots.__all__ if name.startswith("plot_")]
    for name, given_values in wanted.items():
        plt.close("all")
        figure, (ax, other) = plt.subplots(1, 2)
        before = len(ax.get_children())
        assert getattr(plots, name)(*given_values, ax=ax, title="A finding") is ax, name
        assert ax.get_title("left") == "A finding", name
        assert len(ax.get_children()) > before, name
        assert plt.get_fignums() == [figure.number] and not other.has_data(), name
