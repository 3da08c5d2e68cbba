"""With the order constraint, dancers of the packaged model change places as they were asked."""

from itertools import permutations

import dancediff as dd
from dancediff.metrics.swaps import obeys


def test_the_packaged_model_obeys_more_often():
    """Of dances that are not asked every sixth would; docs/results_tcdiffpp.md has more dances."""
    song, model = dd.packaged_song(), dd.load("tcdiffpp")
    obeyed = dict.fromkeys((False, True), 0)
    for S in list(permutations(range(3)))[1:]:
        for seed in range(4):
            for on in obeyed:
                ask = {"dancers": 3, "seconds": 5, "swap": list(S), "order_constraint": on}
                obeyed[on] += obeys(model.generate(song, seed=seed, **ask).root, S)
    assert obeyed[True] >= 18 and obeyed[True] > obeyed[False], obeyed
