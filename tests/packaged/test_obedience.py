"""With the order constraint, dancers of the packaged model change places as they were asked."""

import dancediff as dd
from dancediff.metrics.swaps import obeys


def test_the_packaged_model_obeys_more_often():
    song, model = dd.packaged_song(), dd.load("tcdiffpp")
    ask = {"dancers": 3, "seconds": 5, "steps": 10, "swap": [2, 1, 0]}
    obeyed = {
        on: sum(
            obeys(model.generate(song, seed=seed, order_constraint=on, **ask).root, ask["swap"])
            for seed in range(8)
        )
        for on in (False, True)
    }
    assert obeyed[True] >= 7 and obeyed[True] >= obeyed[False], obeyed
