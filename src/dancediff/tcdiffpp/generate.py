r"""From a song and a wish to a dance: what happens around the network when it is used.

Read first: notebook 00 · `dancediff.tcdiffpp.long_group_sampling`.

Symbols (axes: n dancers · f frames of a segment · F frames of the dance · k segments
         d motion · m music features)
    M        standardised music features                          (F, m), cut: (k, f, m)
    swap     swap[k] = the dancer, counted from the left at the start, who is k-th in the end  (n,)
    x        the dance, normalised, then in metres                (n, F, d)
"""

import math
import operator
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from dancediff.diffusion.guidance import guided, off_at_the_end
from dancediff.diffusion.pinning import MODES
from dancediff.motion.motion import Motion
from dancediff.tcdiffpp import control
from dancediff.tcdiffpp.long_group_sampling import SEAMS, long_group_sample
from dancediff.tcdiffpp.swap_mode import check_order

FPS = 30
LOOK_AHEAD = 30  # frames danced again where a constraint may lie just behind a segment's end
SHORTEST_SONG = 1.0  # seconds; less holds no beat


@dataclass
class Wish:
    """The arguments of `generate`, checked.

    Raises: ValueError naming the argument, its value and what is allowed.

    >>> Wish(max_dancers=5, song_seconds=30.0, dancers=9)
    Traceback (most recent call last):
    ValueError: dancers=9 must lie in 1 ... 5
    """

    max_dancers: int
    song_seconds: float
    num_frames: int = 150
    num_steps: int = 1000
    dancers: int = 3
    seconds: float | None = None
    seed: int = 0
    steps: int = 50
    sampler: str = "ddim"
    guidance: float = 2.0
    eta: float = 1.0
    swap: Any = None
    swap_at: float | None = None
    overlap: int = 75
    pinning: str = "renoise"
    seam: str = "copy"
    start: Any = None
    end: Any = None
    constraints: Any = ()
    in_last = False  # is the order at the end asked for by places in the last frame?

    def __post_init__(self):
        self._check_length()
        self.dancers = _integer("dancers", self.dancers, 1, self.max_dancers)
        self.seed = _integer("seed", self.seed, 0, 2**63 - 1)
        self.steps = _integer("steps", self.steps, 1, self.num_steps)
        self.overlap = _integer("overlap", self.overlap, 1, self.num_frames - 1)
        self.guidance = _number("guidance", self.guidance, 0, 100)
        self.eta = _number("eta", self.eta, 0, 1)
        _one_of("sampler", self.sampler, ("ddim", "ddpm"))
        _one_of("pinning", self.pinning, MODES)
        _one_of("seam", self.seam, tuple(SEAMS))
        if self.swap is not None:
            self.swap = check_order(self.swap, self.dancers)
        elif self.swap_at is not None:
            raise ValueError(f"swap_at={self.swap_at!r} needs swap=, the order to change to")
        if self.swap_at is not None:
            self.swap_at = _number("swap_at", self.swap_at, 0, self.seconds)
        self._combine_constraints()

    def _combine_constraints(self) -> None:
        """What is known of the dance, in metres; the order at its end is a swap, too."""
        asked = list(self.constraints)
        asked += [control.StartAt(self.start)] * (self.start is not None)
        asked += [control.EndAt(self.end)] * (self.end is not None)
        self.known = control.combine(asked, self.dancers, self.frames, FPS)
        self.numbers = None
        if self.known is None:
            return
        if self.pinning != "renoise":
            raise ValueError(f"pinning={self.pinning!r} goes with no constraint; use 'renoise'")
        self.numbers = control.numbers_at_start(self.known)
        order = control.order_at_end(self.known)
        if order is not None and self.swap_at is None:
            if self.swap is not None and self.swap.tolist() != order.tolist():
                raise ValueError(
                    f"swap={self.swap.tolist()} asks for another order than the places at the "
                    f"end, {order.tolist()}; leave one out"
                )
            self.swap, self.in_last = order, True

    def _check_length(self) -> None:
        if self.song_seconds < SHORTEST_SONG:
            raise ValueError(
                f"song is {self.song_seconds:.2f} s long; at least {SHORTEST_SONG:g} s are needed"
            )
        if self.seconds is None:
            self.seconds = self.song_seconds
        seconds = _number("seconds", self.seconds, 0, math.inf)
        if seconds > self.song_seconds + 1e-3:
            raise ValueError(f"seconds={seconds:g} is more than the song's {self.song_seconds:.2f}")
        if round(seconds * FPS) < 1:
            raise ValueError(
                f"seconds={seconds:g} is less than a frame; use at least {1 / FPS:.3f}"
            )
        self.seconds = seconds

    @property
    def frames(self) -> int:
        """Length of the dance in frames."""
        return round(self.seconds * FPS)

    @property
    def stride(self) -> int:
        """Frames that every segment adds."""
        return self.num_frames - self.overlap

    @property
    def segments(self) -> int:
        """How many windows the dance needs; the last may reach beyond its end."""
        return 1 + max(0, math.ceil((self.frames - self.num_frames) / self.stride))

    def target_orders(self) -> list[Tensor | None] | None:
        """Which segment carries out the swap, as `long_group_sample` wants to know it.

        It is the first one that ends at ``swap_at`` or later; by default the last one that ends
        within the dance, so that the whole swap is seen.

        >>> Wish(5, 60.0, seconds=20, dancers=2, swap=[1, 0]).target_orders()
        [None, None, None, None, None, None, tensor([1, 0])]
        >>> Wish(5, 60.0, seconds=10, dancers=2, swap=[1, 0], swap_at=6).target_orders()
        [None, tensor([1, 0]), None]
        """
        if self.swap is None:
            return None
        if self.in_last:
            chosen = self.segments - 1
        elif self.swap_at is None:
            chosen = (self.frames - self.num_frames) // self.stride
        else:
            chosen = math.ceil((self.swap_at * FPS - self.num_frames) / self.stride)
        orders: list[Tensor | None] = [None] * self.segments
        orders[min(max(chosen, 0), self.segments - 1)] = self.swap
        return orders


def cut_music(M: Tensor, segments: int, *, length: int, stride: int) -> Tensor:
    """Overlapping segments of a song; behind its end it starts again.

    What is danced to the repeated part is cut off later, but the window needs some music there.

    Shapes: M (F, m) -> (segments, length, m).

    >>> cut_music(torch.arange(5.0)[:, None], 2, length=4, stride=2)[..., 0].tolist()
    [[0.0, 1.0, 2.0, 3.0], [2.0, 3.0, 4.0, 0.0]]
    """
    needed = length + stride * (segments - 1)
    M = M.repeat(-(-needed // len(M)), 1)[:needed]
    return M.unfold(0, length, stride).transpose(1, 2)


def generate(model, song, *, progress=False, device=None, dtype=None, **options) -> Motion:
    """Dance to a song. See `dancediff.tcdiffpp.model.TCDiffPP.generate`, which calls this."""
    c = model.config
    wish = Wish(
        max_dancers=c.max_dancers,
        song_seconds=song.duration,
        num_frames=c.num_frames,
        num_steps=c.num_steps,
        **options,
    )
    if song.is_silent:
        raise ValueError(f"song {song.name!r} is silent (peak {song.peak:.1e}); there is no beat")
    _one_of("dtype", dtype, (None, torch.float32, torch.bfloat16))
    if device is not None:
        model.to(_device(device))
    was_training = model.training
    try:
        with torch.inference_mode(), _Progress(progress) as report:
            x = _sample(model.eval(), song, wish, report=report, dtype=dtype)
    finally:
        model.train(was_training)
    # cloned: what was made in inference mode could not be used in training
    return Motion.from_features(x.clone(), fps=FPS, meta=_meta(model, song, wish))


def _sample(model, song, wish: Wish, *, report, dtype) -> Tensor:
    device = model.abar.device
    M = model.music_normalizer.normalize(song.features().to(device))
    music = cut_music(M, wish.segments, length=wish.num_frames, stride=wish.stride)
    weight = wish.guidance
    if wish.sampler == "ddpm":
        weight = off_at_the_end(weight, wish.num_steps)

    def denoiser(x_t, t, M, S, *, keep, present=None):
        with torch.autocast(device.type, torch.bfloat16, enabled=dtype == torch.bfloat16):
            return model(x_t, t, M, S, keep=keep, present=present)[1]

    def denoise_segment(x_t, t, M, S):
        return guided(denoiser, M=M, S=S, guidance=weight)(x_t, t)

    known = wish.known and control.normalized(wish.known, model.normalizer)
    x = long_group_sample(
        denoise_segment,
        music,
        dancers=wish.dancers,
        motion_dim=model.config.motion_dim,
        root_x=lambda frame: model.normalizer.unnormalize(frame)[..., 4],
        abar=model.abar,
        target_orders=wish.target_orders(),
        overlap=wish.overlap,
        pinning=wish.pinning,
        spread=model.spread,
        constraint=known,
        numbers=wish.numbers,
        redo=0 if known is None else min(LOOK_AHEAD, wish.overlap // 2),
        seam=wish.seam,
        sampler=wish.sampler,
        steps=wish.steps,
        eta=wish.eta,
        generator=torch.Generator().manual_seed(wish.seed),
        progress=report,
        device=device,
        dtype=torch.float32,
    )
    return model.normalizer.unnormalize(x[:, : wish.frames]).cpu()


def _meta(model, song, wish: Wish) -> dict:
    meta = {
        key: getattr(wish, key)
        for key in ("seed", "seconds", "steps", "sampler", "guidance", "eta", "overlap", "pinning")
    }
    meta |= {"model": getattr(model, "name", "tcdiffpp"), "song": song.name}
    if wish.swap is not None:
        meta |= {"swap": wish.swap.tolist(), "swap_at": wish.swap_at}
    return meta


class _Progress:
    """Turn ``progress=`` into a function (done, total) or None: False, True or such a function."""

    def __init__(self, progress):
        self.progress, self.bar = progress, None

    def __enter__(self):
        if not self.progress or callable(self.progress):
            return self.progress or None
        from tqdm.auto import tqdm

        self.bar = tqdm(desc="dancing", unit="step")

        def report(done: int, total: int) -> None:
            self.bar.total = total
            self.bar.update(done - self.bar.n)

        return report

    def __exit__(self, *error):
        if self.bar is not None:
            self.bar.close()


def _integer(name: str, value, low: int, high: int) -> int:
    try:
        number = operator.index(value)
    except TypeError:
        raise ValueError(f"{name}={value!r} must be an integer in {low} ... {high}") from None
    if not low <= number <= high:
        raise ValueError(f"{name}={number} must lie in {low} ... {high}")
    return number


def _number(name: str, value, low: float, high: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name}={value!r} must be a number in {low:g} ... {high:g}") from None
    if not (low <= number <= high and math.isfinite(number)):
        raise ValueError(f"{name}={number:g} must lie in {low:g} ... {high:g}")
    return number


def _one_of(name: str, value, allowed: tuple) -> None:
    if value not in allowed:
        raise ValueError(f"{name}={value!r} is not one of {', '.join(map(repr, allowed))}")


def _device(device) -> torch.device:
    try:
        device = torch.device(device)
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError, TypeError) as error:
        raise ValueError(f"device={device!r} cannot be used here: {error}") from None
    return device
