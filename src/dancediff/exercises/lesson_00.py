"""Exercises of lesson 00: Tour: music in, dance out."""

import numpy as np

EARLY, SOON, BEFORE = 0.001, 0.05, 0.02  # seconds around a hit
KICK, CLICK, REST = 0.5, (0.1, 0.4), 0.05  # how loud both are, and what is left of them


def _drum(loud, pitch, decay, rate):
    s = np.arange(round(0.15 * rate)) / rate
    return loud * np.cos(2 * np.pi * pitch * s) * np.exp(-s / decay)


def _make_song(bpm, bars, rate):
    beat = 60 / bpm
    song = np.zeros(round(4 * bars * beat * rate))
    kick, click = _drum(0.9, 60, 0.03, rate), _drum(0.3, 1000, 0.01, rate)
    for k in range(4 * (bars - 1)):
        for when, drum in ((k * beat, kick), ((k + 0.5) * beat, click)):
            first = round(when * rate)
            song[first : first + len(drum)] += drum
    return song


def _is_a_song(got, bpm, bars, rate) -> str:
    x, beat = np.asarray(got, dtype=float), 60 / bpm
    where = f"at {bpm} beats a minute, {bars} bars and {rate} samples a second"
    samples = round(4 * bars * beat * rate)
    if x.ndim != 1 or abs(len(x) - samples) > 1:
        return f"shape {x.shape}, expected ({samples},) {where}"
    if not np.isfinite(x).all() or np.abs(x).max() > 1 + 1e-6:
        return f"some of your numbers are outside -1 … 1 {where}"
    last = round(4 * (bars - 1) * beat * rate) + 1
    for k in range(8 * (bars - 1) + 1):  # a kick and a click for each beat; the last bar's begin
        wrong = _hit(np.abs(x), k * beat / 2, rate, kick=k % 2 == 0, sounds=k < 8 * (bars - 1))
        if wrong:
            return f"{wrong} {where}"
    loudest = np.abs(x[last:]).max()
    return "" if loudest < 1e-3 else f"the last bar reaches {loudest:.2g}, expected 0 {where}"


def _hit(loud, when, rate, *, kick, sounds) -> str:
    """What is wrong with a kick or a click, or with the rest before it, or ""."""

    def most(start, stop):
        part = loud[max(0, round((when + start) * rate)) : max(0, round((when + stop) * rate))]
        return part.max(initial=0)

    rest, now = most(-BEFORE, -EARLY), most(-EARLY, SOON)
    if rest > REST:
        return f"{rest:.2f} is left just before {when:.2f} s, expected at most {REST}"
    if sounds and kick and now < KICK:
        return f"the kick at {when:.2f} s reaches {now:.2f}, expected {KICK} or more"
    if sounds and not kick and not CLICK[0] <= now <= CLICK[1]:
        return f"the click at {when:.2f} s reaches {now:.2f}, expected {CLICK[0]} … {CLICK[1]}"
    return ""


SPECS = {
    "00.3": {
        "spec": _make_song,
        "cases": lambda: [(120, 2, 8000), (97, 3, 11025), (150, 4, 22050)],
        "accepts": _is_a_song,
    },
}
