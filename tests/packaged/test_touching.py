"""With collision avoidance, dancers of the packaged model touch less."""

import dancediff as dd
from dancediff.metrics.collision import tif


def test_five_dancers_touch_less():
    song, model = dd.packaged_song(), dd.load("tcdiffpp")
    ask = {"dancers": 5, "seconds": 5, "steps": 10, "guidance": 2}
    touched = {
        on: sum(
            tif(model.generate(song, seed=seed, collision_avoidance=on, **ask).joints())
            for seed in (0, 1)
        )
        for on in (False, True)
    }
    assert touched[False] > 0.1, "nobody met: choose other seeds"
    assert touched[True] < 0.5 * touched[False], touched
