"""The choreographer's dances stay what they are: packaged models and results come from them."""

import numpy as np
import pytest

from dancediff.data.choreographer import GENRES, choreograph

FOUND = [  # genre, dancers, seed, contacts, then: a last place, a pose, how much joints turn
    ("hiphop", 1, 0, 535, [-0.054, 0.8931, 0.075, 40.7014, 0.0648]),
    ("popping", 2, 1, 1393, [0.7526, 0.9146, -0.5322, 43.4593, 0.0666]),
    ("locking", 3, 2, 1962, [0.3392, 0.8595, -0.455, 43.2273, 0.0568]),
    ("house", 5, 3, 2753, [-1.6243, 0.8989, 0.5647, 43.7422, 0.0527]),
    ("waacking", 1, 4, 652, [0.637, 0.9328, 0.0537, 43.5876, 0.078]),
    ("jazz", 2, 5, 1067, [0.7255, 0.796, 0.3798, 42.1991, 0.067]),
    ("salsa", 3, 6, 1752, [-0.0356, 0.9266, -0.5995, 43.5704, 0.0488]),
    ("contemporary", 5, 7, 2730, [-0.1057, 0.9186, -0.3625, 45.4949, 0.0547]),
    ("bollywood", 1, 8, 581, [0.0698, 0.8426, 0.0334, 45.5363, 0.0641]),
    ("kpop", 2, 9, 1361, [-0.9592, 0.8952, 0.653, 42.6365, 0.0621]),
]


@pytest.mark.parametrize(("genre", "n", "seed", "contacts", "numbers"), FOUND)
def test_a_seed_is_danced_as_ever(genre, n, seed, contacts, numbers):
    """To a tenth of a millimetre: on one machine it is to the last bit."""
    beats = np.arange(0.3, 9, 60 / np.mean(GENRES[genre].tempo))
    dance, _ = choreograph(beats, dancers=n, seed=seed, seconds=8.0, genre=genre)
    x = dance.features()
    found = [*x[-1, -1, 4:7], x[0, 100, 7:].sum(), x[..., 7:].std(dim=1).mean()]
    assert int(dance.contact.sum()) == pytest.approx(contacts, abs=2)
    assert [float(value) for value in found] == pytest.approx(numbers, abs=2e-4)
