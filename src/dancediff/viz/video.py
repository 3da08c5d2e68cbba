"""Videos of a dance with its song: H.264 and AAC through PyAV, or an animated GIF through Pillow.

Read first: `dancediff.viz.body` and `dancediff.viz.projection`.

A frame is one collection of filled shapes and a few letters on a background that is copied;
nothing else of matplotlib runs per frame.
"""

from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path

import numpy as np

from dancediff.atomic import atomic_write
from dancediff.motion.motion import Motion
from dancediff.viz.body import (
    body_points,
    dancer_shapes,
    grid_shapes,
    label_spots,
    shadow_shapes,
    to_paths,
    trail_shapes,
)
from dancediff.viz.palette import FLOOR, INK, MUTED, WALL, dancer_color, mix, rgb
from dancediff.viz.projection import Camera, follow

_TRAIL_SECONDS = 1.5
_GIF_FPS = 12.5  # GIF counts in hundredths of a second: 8 of them a frame
_BLOCK = 1024  # samples an AAC frame


class Canvas:
    """Draws the frames of one dance; the same dance gives the same bits.

    >>> import torch
    >>> still = Motion(torch.eye(3).expand(1, 3, 24, 3, 3), torch.zeros(1, 3, 3))
    >>> Canvas(still, size=(64, 36)).frame(0).shape
    (36, 64, 4)
    """

    def __init__(self, motion: Motion, song=None, *, size=(1280, 720)):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.collections import PathCollection
        from matplotlib.figure import Figure

        self.fps, self.size = motion.fps, size
        self.points = body_points(motion)
        in_view = np.concatenate([self.points, label_spots(self.points)[:, :, None]], axis=2)
        self.cameras = follow(in_view, size, fps=motion.fps)
        self.beats = np.zeros(0) if song is None else song.beats()
        # letters scale with the picture, but can be read in a small one
        self.unit = max(size[1] / 720, min(0.6, size[0] / 600))
        self.figure = Figure(figsize=(size[0] / 100, size[1] / 100), dpi=100)
        self.canvas = FigureCanvasAgg(self.figure)
        self.axes = self.figure.add_axes((0, 0, 1, 1))
        self.axes.set(xlim=(0, size[0]), ylim=(0, size[1]))
        self.axes.axis("off")
        self._backdrop("" if song is None else song.name)
        self.shapes = PathCollection([], linewidths=0)
        self.large, self.small = _letters(19 * self.unit), _letters(17 * self.unit)
        self.axes.add_collection(self.shapes)
        self.shapes.set_animated(True)
        self.canvas.draw()
        self.background = self.canvas.copy_from_bbox(self.figure.bbox)

    def _font(self, pixels: float) -> dict:
        return {"fontsize": pixels * self.unit * 0.72, "family": "DejaVu Sans"}

    def _backdrop(self, title: str) -> None:
        horizon = 0.62  # share of the height; the grid fades out below it
        rows = np.linspace(0, 1, 256)[:, None]
        wall, floor = np.array(rgb(WALL)), np.array(rgb(FLOOR))
        blend = 1 / (1 + np.exp(-(rows - horizon) * 14))
        picture = floor + (wall - floor) * blend
        self.axes.imshow(
            picture[:, None], extent=(0, self.size[0], 0, self.size[1]), origin="lower",
            aspect="auto", interpolation="bilinear",
        )  # fmt: skip
        at = (24 * self.unit, 22 * self.unit)
        style = self._font(19) | {"color": MUTED, "parse_math": False}  # "$" in a name
        letters = _letters(19 * self.unit)
        room = self.size[0] - 3 * at[0] - letters.getlength("000.0 s   beat 0000")
        self.axes.text(*at, _shortened(title, letters, room), **style)

    def frame(self, position: float) -> np.ndarray:
        """The picture at a frame number, RGBA (h, w, 4) uint8; fractions are blended."""
        low = int(np.clip(np.floor(position), 0, self.points.shape[1] - 1))
        high = min(low + 1, self.points.shape[1] - 1)
        part = float(np.clip(position - low, 0, 1)) if high > low else 0.0
        points = self.points[:, low] * (1 - part) + self.points[:, high] * part
        camera = self.cameras[low] if part < 0.5 else self.cameras[high]
        pulse, count = self._beat(position / self.fps)
        floor = grid_shapes(camera, pulse) + self._trails(low, camera)
        bodies = shadow_shapes(points, camera) + dancer_shapes(points, camera)
        paths, colors = to_paths(floor + bodies)
        self.shapes.set_paths(paths)
        self.shapes.set_facecolor(colors)
        self.canvas.restore_region(self.background)
        self.axes.draw_artist(self.shapes)
        picture = np.array(self.canvas.buffer_rgba())
        self._write(picture, points, camera, position / self.fps, count)
        return picture

    def _beat(self, time: float) -> tuple[float, int]:
        """How strongly the last beat still glows (1 on it, 0 after 0.3 s), and its number."""
        count = int(np.searchsorted(self.beats, time + 1e-6, side="right"))
        age = time - self.beats[count - 1] if count else np.inf
        return max(0.0, 1 - age / 0.3), count

    def _trails(self, index: int, camera: Camera):
        start = max(0, index - round(_TRAIL_SECONDS * self.fps))
        paths = self.points[:, start : index + 1 : 3, 0]
        return [s for k, p in enumerate(paths) for s in trail_shapes(p, camera, dancer_color(k))]

    def _write(self, picture, points, camera: Camera, time: float, count: int) -> None:
        """Time, beat and the dancers' numbers; matplotlib takes as long for them as for bodies."""
        width, height = self.size
        beat = f"   beat {count}" if count else ""
        corner = (width - 24 * self.unit, height - 22 * self.unit)
        _print(picture, corner, f"{time:4.1f} s{beat}", MUTED, self.large, anchor="rs")
        for k, (x, y) in enumerate(camera.project(label_spots(points))[0]):
            ink = tuple(round(255 * c) for c in mix(dancer_color(k), INK, 0.3))
            _print(picture, (x, height - y), str(k), ink, self.small, anchor="mm")


def _letters(pixels: float):
    """A font of that size, of those that matplotlib brings."""
    import matplotlib
    from PIL import ImageFont

    font = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
    return ImageFont.truetype(font, pixels)


def _shortened(name: str, font, width: float) -> str:
    """A name that is no wider than so many pixels; "…" stands for what is left out."""
    short = name
    while short and font.getlength(short if short == name else f"{short}…") > width:
        short = short[:-1]
    return name if short == name else f"{short.rstrip()}…"


def _print(picture, at, text: str, ink, font, anchor: str) -> None:
    """Print text into a picture (h, w, 4); Pillow is handed no more of it than it changes."""
    from PIL import Image, ImageDraw

    box = ImageDraw.Draw(Image.new("L", (1, 1))).textbbox(at, text, font=font, anchor=anchor)
    left, top = (max(int(side) - 1, 0) for side in box[:2])
    part = picture[top : max(int(box[3]) + 2, 0), left : max(int(box[2]) + 2, 0)]
    if part.size:
        image = Image.fromarray(np.ascontiguousarray(part))
        spot = (at[0] - left, at[1] - top)
        ImageDraw.Draw(image).text(spot, text, ink, font, anchor=anchor)
        part[:] = np.asarray(image)


def save_video(motion: Motion, path, song=None, *, size=None, fps: float | None = None) -> Path:
    """Draw a dance as .mp4 (with sound if a song is given) or as animated .gif (always silent).

    ``size`` is (width, height) in pixels, default (1280, 720), for a GIF (480, 270); ``fps``
    defaults to the motion's, for a GIF to 12.5. Frames of a GIF last whole hundredths of a second,
    two or more: it takes the nearest such rate. The song starts with the dance and is cut to its
    length. The file appears whole or not at all.
    Raises: ValueError for another suffix or an odd size; ImportError naming the extra when an
    .mp4 is asked for and PyAV is not installed.
    """
    path = Path(path)
    if path.suffix not in (".mp4", ".gif"):
        raise ValueError(f"suffix {path.suffix!r} of {path} is unknown; use .mp4 or .gif")
    gif = path.suffix == ".gif"
    size = size or ((480, 270) if gif else (1280, 720))
    fps = fps or (_GIF_FPS if gif else motion.fps)
    if size[0] % 2 or size[1] % 2 or min(size) < 16:
        raise ValueError(f"size={size} must be two even numbers of at least 16 pixels")
    if not fps > 0:
        raise ValueError(f"fps={fps} must be positive")
    with atomic_write(path) as part:
        (_write_gif if gif else _write_mp4)(motion, part, song, size, fps)
    return path


def _frames(motion: Motion, song, size, fps: float):
    canvas = Canvas(motion, song, size=size)
    for k in range(max(1, round(motion.duration * fps))):
        yield canvas.frame(k * motion.fps / fps)


def _write_gif(motion: Motion, path: Path, song, size, fps: float) -> None:
    from PIL import Image

    wait = max(20, round(100 / fps) * 10)  # ms; drawn at ``fps`` it would play too fast or slow
    pictures = [Image.fromarray(f[..., :3]) for f in _frames(motion, song, size, 1000 / wait)]
    # one palette for all frames, or the colours flicker
    first = pictures[len(pictures) // 2].quantize(128)
    pictures = [p.quantize(palette=first, dither=Image.Dither.NONE) for p in pictures]
    pictures[0].save(
        path, format="GIF", save_all=True, append_images=pictures[1:], duration=wait, loop=0
    )


def _import_av():
    try:
        import av
    except ImportError as err:
        raise ImportError(
            'writing .mp4 needs PyAV: pip install "dancediff[video]" (or save as .gif)'
        ) from err
    return av


def _write_mp4(motion: Motion, path: Path, song, size, fps: float) -> None:
    av = _import_av()
    with av.open(str(path), "w", format="mp4", options={"movflags": "+faststart"}) as file:
        rate = Fraction(fps).limit_denominator(1001)
        video = file.add_stream("libx264", rate=rate, options={"crf": "20", "preset": "superfast"})
        video.width, video.height = size
        video.pix_fmt = "yuv420p"
        video.codec_context.thread_type = "FRAME"  # else x264 keeps us waiting for each picture
        audio = None
        if song is not None:
            # the stream must exist before the first packet is written
            audio = file.add_stream("aac", rate=48000, layout="stereo")
            audio.bit_rate = 160_000

        def encode(picture):
            return video.encode(av.VideoFrame.from_ndarray(picture, format="rgba"))

        with ThreadPoolExecutor(1) as encoder:  # a picture is packed while the next is drawn
            packed = encoder.submit(_pack_sound, av, audio, song, motion.duration)
            for picture in _frames(motion, song, size, fps):
                file.mux(packed.result())
                packed = encoder.submit(encode, picture)
            file.mux(packed.result())
        file.mux(video.encode())


def _pack_sound(av, stream, song, seconds: float) -> list:
    """The first ``seconds`` of the song as packets, at full scale cut to [-1, 1]."""
    if song is None:
        return []
    samples = song.audio[: round(seconds * song.rate)]
    samples = np.clip(samples[:, :2] if samples.shape[1] > 1 else samples.repeat(2, 1), -1, 1)
    resampler = av.AudioResampler(format="fltp", layout="stereo", rate=48000, frame_size=_BLOCK)
    packets = []
    for start in range(0, len(samples), song.rate):
        block = np.ascontiguousarray(samples[start : start + song.rate].T)
        frame = av.AudioFrame.from_ndarray(block, format="fltp", layout="stereo")
        frame.sample_rate, frame.pts = song.rate, start
        frame.time_base = Fraction(1, song.rate)
        for piece in resampler.resample(frame):
            packets += stream.encode(piece)
    for piece in resampler.resample(None):
        packets += stream.encode(piece)
    return packets + stream.encode()
