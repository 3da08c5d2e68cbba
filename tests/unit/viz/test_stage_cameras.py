import numpy as np
import pytest

from dancediff.viz.stage_cameras import FIELD, middle, views


def seen(view, points, aspect):
    """Whether points lie inside the picture, by projecting them as a camera does."""
    eye, target = np.array(view["eye"]), np.array(view["target"])
    ahead = (target - eye) / np.linalg.norm(target - eye)
    side = np.cross(ahead, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    up = np.cross(side, ahead)
    way = points - eye
    reach = np.tan(np.radians(FIELD / 2)) * (way @ ahead)
    return (np.abs(way @ up) < reach) & (np.abs(way @ side) < reach * aspect)


@pytest.mark.parametrize("width", [0.0, 3.0, 12.0])
@pytest.mark.parametrize("depth", [0.0, 5.0])
def test_everybody_is_seen_from_head_to_toe(width, depth):
    root = np.random.default_rng(0).uniform(-1, 1, (5, 60, 3)) * [width / 2, 0, depth / 2]
    for name, view in zip(("Orbit", "Top view"), views(root, 30.0, 16 / 9), strict=False):
        assert view["name"] == name
        for height in (0.0, 1.8):
            assert seen(view, root + np.array([0, height, 0]), 16 / 9).all()


def test_follow_sees_the_group_wherever_it_goes():
    walk = np.linspace(0, 40, 600)[:, None] * [1.0, 0.0, 0.0]
    root = np.array([[-1.0, 0, 0], [1.0, 0, 0]])[:, None] + walk
    orbit, _, follow = views(root, 30.0, 16 / 9)
    assert follow["follows"] and not orbit["follows"]
    assert np.linalg.norm(follow["eye"]) < 0.4 * np.linalg.norm(orbit["eye"])
    group = root - middle(root, 30.0)
    assert seen(follow, group, 16 / 9).all()


def test_middle_glides():
    shaking = np.zeros((1, 90, 3))
    shaking[0, ::2, 0] = 0.1
    path = middle(shaking, 30.0)
    assert path.shape == (90, 3) and np.abs(np.diff(path[20:70, 0])).max() < 0.005


def test_one_frame_has_a_middle():
    np.testing.assert_allclose(middle(np.ones((2, 1, 3)), 30.0), [[1, 0, 1]], atol=1e-6)
