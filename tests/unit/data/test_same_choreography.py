"""The choreographer's dances stay what they are: packaged models and results come from them."""

import numpy as np
import pytest

from dancediff.data.choreographer import GENRES, choreograph

FOUND = [  # genre, dancers, seed, contacts, then: a last place, a pose, how much joints turn
    ("hiphop", 1, 0, 535, [-0.054, 0.8931, 0.075, 40.7014, 0.0648]),
    ("popping", 2, 1, 1737, [-0.6964, 0.8857, -0.5335, 45.4431, 0.061]),
    ("locking", 3, 2, 1853, [-0.4406, 0.8542, 0.2684, 43.3403, 0.0631]),
    ("house", 5, 3, 3029, [-1.4001, 0.9984, 0.0547, 43.6526, 0.044]),
    ("waacking", 1, 4, 652, [0.637, 0.9328, 0.0537, 43.5876, 0.078]),
    ("jazz", 2, 5, 982, [0.6151, 0.8948, 0.6456, 44.6957, 0.0773]),
    ("salsa", 3, 6, 1775, [0.0367, 0.9372, 0.0711, 43.5871, 0.0505]),
    ("contemporary", 5, 7, 2620, [-0.279, 0.9321, -0.8594, 45.0425, 0.057]),
    ("bollywood", 1, 8, 581, [0.0698, 0.8426, 0.0334, 45.5363, 0.0641]),
    ("kpop", 2, 9, 1344, [-1.1059, 0.8754, 0.7906, 42.5738, 0.0618]),
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
