"""Pictures of a bench can be read, whatever the configs are called."""

import matplotlib.pyplot as plt

from dancediff.bench import pictures


def test_ticks_are_few_and_names_are_no_formulas(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(pictures, "save_figure", lambda figure, *a, **k: drawn.append(figure))
    points = [
        {"config": name, "minutes": k, "spent": 60.0 * k, "windows": 1000 * k, "scores": scores}
        for scores in [{"150": {"FID_k": [3.0, None, None]}}]
        for name in (r"$\frac$", "b")
        for k in (1, 2, 5)
    ]
    pictures.draw_quality(points, ["FID_k"], tmp_path / "quality.png")
    drawn[0].canvas.draw()  # refuses a formula that is none
    spent, windows = drawn[0].axes
    assert {"1k", "2k"} <= {text.get_text() for text in windows.get_xticklabels()}
    assert not any(text.get_text() for text in spent.get_xticklabels(minor=True))
    plt.close("all")
