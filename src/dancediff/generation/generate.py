r"""From a song and a wish to a dance: what happens around the network when it is used.

Read first: notebook 00 · `dancediff.papers.tcdiffpp.long_group_sampling`.

Symbols (axes: n dancers · f frames of a segment · F frames of the dance · k segments
         d motion · m music features)
    M        standardised music features                          (F, m), cut: (k, f, m)
    swap     swap[k] = the dancer, counted from the left at the start, who is k-th in the end  (n,)
    x        the dance, normalised, then in metres                (n, F, d)
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.guidance import guided, off_at_the_end
from dancediff.diffusion.pinning import HOLDING
from dancediff.extensions import control
from dancediff.extensions.autoguidance import LASTING_SHARE, ROOT_SHARE, autoguided
from dancediff.extensions.collision_avoidance import CollisionAvoidance
from dancediff.extensions.constraint import Conditioning
from dancediff.extensions.foot_contact_projection import foot_contact_hook
from dancediff.extensions.frequency_clip import FrequencyClip
from dancediff.extensions.initial_frames import InitialFrames
from dancediff.extensions.order_constraint import OrderConstraint
from dancediff.generation.request import Wish
from dancediff.motion.motion import Motion
from dancediff.motion.representation import cut_to_range
from dancediff.nn.decoder import music_heard_once
from dancediff.nn.precision import chosen_dtype
from dancediff.papers.tcdiffpp.long_group_sampling import LongGroupSampler

AUTOGUIDANCE = 1.5  # of preconditioned models; docs/drift.md
LOOK_AHEAD = 30  # frames sampled again where a constraint may lie just behind a segment's end


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


def generate(
    model,
    song,
    *,
    draw=None,
    describe=None,
    progress=False,
    watch=None,
    device=None,
    dtype=None,
    **options,
) -> Motion:
    """Dance to a song. See `dancediff.papers.tcdiffpp.model.TCDiffPP.generate`, which calls this.

    ``draw(model, song, wish, report=, dtype=)`` replaces Long Group Diffusion Sampling; it returns
    features (n, F, d) in metres. ``describe(model, song, wish)`` is what the dance says of itself,
    `facts_of` by default. ``watch`` is for Long Group Diffusion Sampling only.
    """
    wish, dtype = _prepared(model, song, device, dtype, options)
    draw = draw or partial(draw_long_group, watch=watch)
    was_training = model.training
    try:
        with torch.inference_mode(), music_heard_once(model), _Progress(progress) as report:
            x = draw(model.eval(), song, wish, report=report, dtype=dtype)
    finally:
        model.train(was_training)
    # cloned: what was made in inference mode could not be used in training
    return Motion.from_features(x.clone(), fps=FPS, meta=(describe or facts_of)(model, song, wish))


def stream(
    model,
    song,
    *,
    draw=None,
    describe=None,
    progress=False,
    device=None,
    dtype=None,
    **options,
) -> Iterator[Motion]:
    """The same dance as `generate`, handed out piece by piece as segments are ready.

    Memory does not grow with the song: what was handed out is forgotten. The arguments are checked
    at once, the dancing begins with the first piece that is asked for. ``draw`` is that of
    `generate`, but yields pieces (n, f, d).

    Raises: ValueError as `generate`.
    """
    wish, dtype = _prepared(model, song, device, dtype, options)
    pieces = partial(draw or segments, model, song, wish, dtype=dtype)
    return _pieces(model, wish, pieces, partial(describe or facts_of, model, song, wish), progress)


def _pieces(model, wish: Wish, draw, describe, progress) -> Iterator[Motion]:
    was_training, left = model.training, wish.frames
    model.eval()
    try:
        with music_heard_once(model), _Progress(progress) as report:
            for x in draw(report=report):
                if left > 0:
                    yield Motion.from_features(x[:, :left].clone(), fps=FPS, meta=describe())
                left -= x.shape[1]
    finally:
        model.train(was_training)


def _prepared(model, song, device, dtype, options: dict) -> tuple[Wish, torch.dtype | None]:
    """Check the arguments, move the model to where it shall compute, decide with what digits."""
    c = model.config
    wish = Wish(
        max_dancers=c.max_dancers,
        song_seconds=song.duration,
        num_frames=c.num_frames,
        num_steps=c.num_steps,
        **options,
    )
    for name in ("spacing", "order"):
        if getattr(wish, name) == "kept" and model.spread is None:
            raise ValueError(
                f"{name}='kept' bends guesses by the spread of the training data, which a model "
                "with precondition=False does not know; use 'free'"
            )
    if (wish.autoguidance or 1) != 1 and not model.config.precondition:
        raise ValueError(
            f"autoguidance={wish.autoguidance:g} pushes guesses away from the linear one, which a "
            "model with precondition=False does not have; use 1"
        )
    if song.is_silent:
        raise ValueError(f"song {song.name!r} is silent (peak {song.peak:.1e}); there is no beat")
    device = model.abar.device if device is None else usable_device(device)
    dtype = chosen_dtype(dtype, device)
    model.to(device)
    return wish, dtype


def binder(model, guidance, dtype=None, autoguidance: float = 1.0) -> Callable:
    """``bind(conditions) -> denoise(x_t, t)``: the model with guidance.

    ``guidance``: a weight or a function of t, see `dancediff.diffusion.guidance.guided`;
    ``autoguidance``: see `dancediff.extensions.autoguidance.autoguided`.
    """
    device = model.abar.device

    def denoise(x_t, t, conditions):
        with torch.autocast(device.type, torch.bfloat16, enabled=dtype == torch.bfloat16):
            return model.denoise(x_t, t, conditions)

    def bind(conditions: Conditions) -> Callable[[Tensor, int], Tensor]:
        def linear(x_t, t):
            steps = torch.full((len(x_t),), t, dtype=torch.long, device=device)
            return model.linear_guess(x_t, steps, conditions)

        return autoguided(
            guided(denoise, conditions, guidance),
            linear,
            autoguidance,
            root_share=ROOT_SHARE,
            lasting_share=LASTING_SHARE,
        )

    return bind


def autoguidance_of(model, wish: Wish) -> float:
    """The weight that was wished for, or the usual one of a model that can."""
    if wish.autoguidance is None:
        wish.autoguidance = AUTOGUIDANCE if model.config.precondition else 1.0
    return wish.autoguidance


def draw_long_group(model, song, wish: Wish, **how) -> Tensor:
    """Sample a dance segment after segment: features (n, F, d) in metres, on the CPU."""
    return torch.cat(list(segments(model, song, wish, **how)), dim=1)[:, : wish.frames]


def segments(model, song, wish: Wish, *, report=None, watch=None, dtype=None) -> Iterator[Tensor]:
    """Finished pieces of a dance, features (n, f, d) in metres, on the CPU."""
    sampler = long_group_sampler(model, song, wish, dtype=dtype)

    def callback(done: int, total: int, x0_hat: Tensor) -> None:
        if report is not None:
            report(done, total)
        if watch is not None:
            watch(done, total, _guess(model, x0_hat))

    for x in replace(sampler, callback=callback).pieces():
        yield model.normalizer.unnormalize(x).cpu()


def long_group_sampler(model, song, wish: Wish, *, dtype=None) -> LongGroupSampler:
    """How a wish is danced by TCDiff++."""
    device = model.abar.device
    M = model.music_normalizer.normalize(song.features().to(device))
    usual = "free" if model.spread is None else "kept"
    wish.spacing, wish.order = wish.spacing or usual, wish.order or usual
    weight = wish.guidance
    if wish.sampler == "ddpm":
        weight = off_at_the_end(weight, wish.num_steps)
    return LongGroupSampler(
        shape=(wish.dancers, wish.num_frames, model.config.motion_dim),
        bind=binder(model, weight, dtype, autoguidance_of(model, wish)),
        music=cut_music(M, wish.segments, length=wish.num_frames, stride=wish.stride),
        root_x=lambda frame: model.normalizer.unnormalize(frame)[..., 4],
        targets=wish.target_orders() or (),
        overlap=wish.overlap,
        pinning=wish.pinning,
        seam=wish.seam,
        resampled=_resampled(wish),
        hooks=hooks_of(model, wish),
        mask=None if wish.known is None else wish.known.mask,
        initial_order=wish.numbers,
        settings={
            "abar": model.abar,
            "sampler": wish.sampler,
            "steps": wish.steps,
            "eta": wish.eta,
            "clamp": largest_guess(model),
            "generator": torch.Generator().manual_seed(wish.seed),
            "device": device,
        },
    )


def hooks_of(model, wish: Wish) -> list:
    """What changes guesses while a wish is danced by TCDiff++."""
    normalizer, hooks, sources = model.normalizer.on_cpu(), [], []
    if wish.pinning in HOLDING and wish.seam == "copy":
        sources.append(InitialFrames())
    if wish.known is not None:
        sources.append(control.normalized(wish.known, normalizer))
    if wish.order == "kept":
        sources.append(OrderConstraint(normalizer))
    if wish.spacing == "kept":
        sources.append(CollisionAvoidance(normalizer))
    if model.spread is not None:
        hooks.append(Conditioning(model.spread.cpu(), sources))
    return hooks + [foot_contact_hook(normalizer)] * (wish.feet == "planted")


def _guess(model, x0_hat: Tensor) -> Motion:
    """A guess as a dance, (n, f, d); cloned, as what was made in inference mode is of no use."""
    return Motion.from_features(model.normalizer.unnormalize(x0_hat).cpu().clone(), fps=FPS)


def largest_guess(model) -> Callable[[Tensor], Tensor]:
    """Where guesses are cut: at the training range, as published, or frequency by frequency."""
    if not model.config.precondition:
        return cut_to_range
    return FrequencyClip(model.decoder.precondition.mean, model.decoder.precondition.spread)


def _resampled(wish: Wish) -> int:
    """How much of the overlap is sampled again, see `LongSampler`."""
    return 0 if wish.known is None else min(LOOK_AHEAD, wish.overlap // 2)


def facts_of(model, song, wish: Wish) -> dict:
    """What a dance says of how it was made, for ``Motion.meta``."""
    meta = {
        key: getattr(wish, key)
        for key in (
            "seed",
            "seconds",
            "steps",
            "sampler",
            "guidance",
            "autoguidance",
            "eta",
            "overlap",
            "pinning",
            "feet",
            "spacing",
            "order",
        )
    }
    meta |= {"model": getattr(model, "name", "tcdiffpp"), "song": song.name}
    for name in ("autoguidance", "spacing", "order"):
        if meta[name] is None:
            del meta[name]  # whoever drew the dance knows nothing of it
    # the frames in which a segment takes over from the one before; metrics look for faults there
    first = wish.num_frames - _resampled(wish)
    meta["seams"] = list(range(first, wish.frames, wish.stride)) if wish.segments > 1 else []
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


def usable_device(device) -> torch.device:
    """The device of that name.

    Raises: ValueError when it cannot hold a tensor here.

    >>> usable_device("cpu")
    device(type='cpu')
    """
    try:
        device = torch.device(device)
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError, TypeError) as error:
        raise ValueError(f"device={device!r} cannot be used here: {error}") from None
    return device
