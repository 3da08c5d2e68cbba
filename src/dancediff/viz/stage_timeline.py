"""Below the stage: play, slider with beats, clock, speed, loop, views, marks, and what drives them.

Playing happens in the browser alone. ipywidgets' own `Play` and `jslink` would send frame after
frame to the kernel. Instead one piece of JavaScript (``assets/stage/conductor.js``) moves the clip,
the slider and the clock; the song, where there is one, is what it reads time from. pythreejs runs
it for us, see `dancediff.viz.in_page`.
"""

from dancediff.viz.in_page import in_page
from dancediff.viz.palette import BEAT, MUTED
from dancediff.viz.skin import rest_joints
from dancediff.viz.style import mp3

SPEEDS = ("0.25", "0.5", "1")
EDGE = 6  # pixels from the side of the slider to the middle of its handle in frame 0


def make_controls(widgets, width: int, frames: int, fps: float, views: list[str], song) -> dict:
    """All that can be pressed, by name, and the clock. Nothing of it is linked yet."""
    wide, narrow = {"width": f"{width}px", "margin": "0"}, {"width": "auto"}
    parts = {
        "ticks": widgets.HTML(ticks(width, frames, fps, song), layout=wide),
        "slider": widgets.IntSlider(max=frames - 1, readout=False, layout=wide),
        "play": widgets.ToggleButton(description="▶ Play", layout={"width": "100px"}),
        "clock": widgets.HTML("0.00 s · frame 0", layout={"width": "150px"}),
        "speed": widgets.Dropdown(
            options=SPEEDS,
            value="1",
            description="speed",
            layout={"width": "110px"},
            style={"description_width": "initial"},
        ),
        "loop": widgets.Checkbox(True, description="loop", indent=False, layout=narrow),
        "views": widgets.ToggleButtons(options=views, style={"button_width": "80px"}),
        "trails": widgets.Checkbox(True, description="Trails", indent=False, layout=narrow),
        "contacts": widgets.Checkbox(
            True, description="Feet on the floor", indent=False, layout=narrow
        ),
    }
    if song is not None:
        parts["sound_on"] = widgets.Checkbox(True, description="sound", indent=False, layout=narrow)
        parts["sound"] = widgets.Audio(value=mp3(song, frames / fps), format="mp3", autoplay=False)
    return parts


def ticks(width: int, frames: int, fps: float, song) -> str:
    """A ruler as long as the slider's way: a mark every second or five, a stroke a beat.

    >>> ticks(760, 151, 30.0, None).count("<text"), ticks(760, 601, 30.0, None).count("<text")
    (6, 5)
    """

    def place(seconds: float) -> float:
        return EDGE + (width - 2 * EDGE) * seconds * fps / max(frames - 1, 1)

    last = (frames - 1) / fps
    beats = [] if song is None else [beat for beat in song.beats() if beat <= last]
    strokes = "".join(
        f'<rect x="{place(beat) - 0.75:.1f}" y="12" width="1.5" height="8" fill="{BEAT}"/>'
        for beat in beats
    )
    words = "".join(
        f'<text x="{max(place(second), 9):.1f}" y="9" text-anchor="middle">{second} s</text>'
        for second in range(0, int(last) + 1, 1 if last < 12 else 5)
    )
    style = f"display:block;overflow:visible;font:10px sans-serif;fill:{MUTED}"
    return (
        f'<svg width="{width}" height="20" style="{style}" role="img" '
        f'aria-label="{len(beats)} beats of the song">{words}{strokes}</svg>'
    )


def conduct(p3, models: dict, frames: int, fps: float, views: list[dict]):
    """Hand the conductor to the page; ``models`` are the widgets that it moves or listens to."""
    facts = {
        "models": {name: widget.model_id for name, widget in models.items()},
        "frames": frames,
        "fps": fps,
        "views": views,
        "rest": rest_joints().tolist(),  # a skin's bones are bound there
    }
    return in_page(p3, "conductor.js", facts)
