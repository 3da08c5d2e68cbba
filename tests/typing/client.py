"""A program of somebody else, which the type checker reads and nobody runs (`make lint`)."""

from pathlib import Path

import dancediff as dd


def main() -> None:
    song: dd.Music = dd.packaged_song()
    seconds: float = song.duration
    models: list[str] = dd.packaged_models()
    kinds: list[str] = list(dd.genres())

    pipeline = dd.load(models[0])
    dance = pipeline.generate(song, dancers=3, seconds=10, seed=1)
    again: dd.Motion = dd.Motion.load("dance.npz")
    file: Path = again.save("dance.glb", body="mesh")
    people: int = again.num_dancers
    first: dd.Motion = again.dancer(0).seconds(0.0, 2.5)
    positions = first.joints().shape
    group: dd.Motion = dd.Motion.side_by_side([first, first])

    moves, facts = dd.choreograph([0.5, 1.0, 1.5], dancers=2, seed=0)
    report = dd.evaluate(group, song)
    hits: float = report["BAS"].value
    report.save("report.json")
    dd.play(group, song)

    group.fps = "30"  # type: ignore[assignment]  # checked: the types are there, and not all Any
