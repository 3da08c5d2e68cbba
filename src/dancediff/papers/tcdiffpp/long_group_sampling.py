r"""Long Group Diffusion Sampling (LGDS): a dance of any length from a network that knows 5 seconds.

Read first: notebook 10 · TCDiff++ section 4.4, eq. 19 · `dancediff.diffusion.pinning`.

Symbols (axes: n dancers · f frames of one segment · F frames of the dance · k segments
         d motion features · m music features)
    x        the dance, normalised; row i is dancer i for good         (n, F, d)
    overlap  frames that a segment shares with the one before it       75 of 150 in the paper
    known    those of them that are kept                               (n, overlap - redo, d)
    order    order[r] = the dancer who is r-th from the left at the segment's first frame   (n,)
    S        swap mode, in ranks at the segment's own first frame      (n,)

Each segment begins with the end of the one before: those frames are pinned, the rest is sampled.
The network was trained on dancers ranked left to right at the window's first frame, so they are
handed over in that order and put back afterwards; nobody is ever renamed.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import torch
from torch import Tensor

from dancediff.diffusion.pinning import MODES, Pinning
from dancediff.diffusion.samplers import sample
from dancediff.diffusion.schedule import gaussian, send
from dancediff.extensions.collision_avoidance import Spacing
from dancediff.extensions.constraint import Bending, Constraint
from dancediff.extensions.foot_contact_projection import Planting, held, one_after_the_other
from dancediff.extensions.order_constraint import Order
from dancediff.motion.order import check_order, left_to_right, relative_order
from dancediff.motion.representation import Normalizer


def long_group_sample(denoise_segment: Callable, segments_music: Tensor, **options) -> Tensor:
    r"""Sample a whole dance, segment after segment.

    $$\hat z_T^{[75:225]} = \big[\hat x_T^{[75:150]},\ z_T^{[150:225]}\big]$$

    Source: TCDiff++ eq. 19 (``pinning="init"``).  Differs: the default pinning is "renoise". The
    released code pastes clean frames at every noise level, and loses the first segment, so that
    dance and music are 2.5 s apart.

    Shapes: segments_music (k, f, m); ``options`` are those of `iter_long_group_sample`
    -> (n, f + (k - 1)(f - overlap), d).

    >>> from dancediff.diffusion.schedule import cosine_abar
    >>> def stand(x_t, t, M, S):  # a "network" that knows one dance: everybody stands in a line
    ...     return torch.linspace(-0.5, 0.5, x_t.shape[1])[None, :, None, None].expand_as(x_t)
    >>> x = long_group_sample(stand, torch.zeros(3, 150, 35), dancers=2, motion_dim=1, steps=2,
    ...     root_x=lambda frame: frame[:, 0], abar=cosine_abar(), device="cpu", dtype=torch.float32)
    >>> x.shape
    torch.Size([2, 300, 1])
    """
    return torch.cat(list(iter_long_group_sample(denoise_segment, segments_music, **options)), 1)


def iter_long_group_sample(
    denoise_segment: Callable[[Tensor, int, Tensor, Tensor], Tensor],
    segments_music: Tensor,
    *,
    dancers: int,
    motion_dim: int,
    root_x: Callable[[Tensor], Tensor],
    abar: Tensor,
    target_orders: Sequence | None = None,
    overlap: int = 75,
    pinning: str = "renoise",
    t_star: int | None = None,
    spread: Tensor | None = None,
    constraint: Constraint | None = None,
    plant_with: Normalizer | None = None,
    part_with: Normalizer | None = None,
    order_with: Normalizer | None = None,
    numbers: Tensor | None = None,
    redo: int = 0,
    seam: str = "copy",
    sampler: str = "ddim",
    steps: int = 50,
    eta: float = 1.0,
    resample: int = 1,
    clamp: float | Callable[[Tensor], Tensor] | None = 1.0,
    generator: torch.Generator | None = None,
    progress: Callable[[int, int], None] | None = None,
    watch: Callable[[int, int, Tensor], None] | None = None,
    device: torch.device | str,
    dtype: torch.dtype,
) -> Iterator[Tensor]:
    r"""`long_group_sample`, handing out finished frames as it goes: memory stays that of a segment.

    - ``denoise_segment(x_t (1, n, f, d), t, M (1, f, m), S (1, n)) -> x0_hat``, guidance included.
    - ``root_x(frame (n, d)) -> (n,)``: lateral position, by which dancers are ranked.
    - ``target_orders[i]``: the dancers from left to right at the last frame of segment i, or None:
      the order asked for last or, if none was, the order they stand in now.
    - ``pinning``, ``t_star``: see `Pinning`. With "init" the shared frames also get the noise they
      were made from; it carries furthest with eta = 0.
    - ``spread`` to ``order_with``, what guesses are bent with, are on the CPU (see `sample`).
    - ``spread`` (k, d), of each frequency in the training set: with it "same_noise" and "renoise"
      also bend every guess so that it sets out from the known frames (`Constraint`).
    - ``constraint``: what is known of the dance beforehand, frame by frame (n, F, d); needs spread.
    - ``plant_with``: the normaliser of the motion, to plant feet (`Planting`); None: leave them.
    - ``part_with``: the same, to keep dancers apart (`Spacing`); needs spread.
    - ``order_with``: the same, for who is asked to change places to do so (`Order`); needs spread.
    - ``numbers``: the dancers from left to right at the first frame, when the caller has numbered
      them; else they are numbered from the left.
    - ``redo``: so many shared frames are danced again instead of kept, so that a constraint shortly
      behind a segment's end is not noticed too late.
    - ``seam``: "copy" keeps the shared frames, "fade" blends both versions (a key of `SEAMS`).
    - ``sampler``, ``steps``, ``eta``, ``resample``, ``clamp``: see `sample`.
    - ``progress(done, total)`` counts denoising steps over the whole dance.
    - ``watch(done, total, x0_hat)``: also the guess of that step, (n, f, d) of the segment.

    Shapes: segments_music (k, f, m) standardised, segment i starting at frame i (f - overlap)
    -> pieces (n, F', d) in normalised units, each final when it is handed out.
    Raises: ValueError for an overlap outside 1 ... f - 1, an unknown seam, an order that is none.
    """
    segments, f, _ = segments_music.shape
    _check_options(segments, f, overlap=overlap, pinning=pinning, seam=seam, targets=target_orders)
    _check_constraint(constraint, spread, overlap, redo)
    stride, abar = f - overlap, abar.cpu()
    asked = known = z = None
    for i, M in enumerate(segments_music.to(device=device, dtype=dtype).split(1)):
        if target_orders is not None and target_orders[i] is not None:
            asked = check_order(target_orders[i], dancers, name=f"target_orders[{i}]")
        order, now = _orders(known, root_x, dancers, numbers)
        S = relative_order(now if asked is None else asked, order)

        noise, pin = gaussian((dancers, f, motion_dim), generator=generator), None
        if known is not None:
            pin = Pinning(
                known[order][None],
                abar,
                mode=pinning,
                t_star=t_star,
                hold_last=False,  # the seam decides what becomes of the known frames
                generator=generator,
            )
            if pinning == "init":
                noise[:, : known.shape[1]] = z[order, stride : stride + known.shape[1]]
        follows = pinning in HOLDING and seam == "copy" and spread is not None
        sets_out = known if follows else None
        told = _told(constraint, sets_out, i * stride, f)
        told = told and told.dancers(order)
        rules = () if order_with is None or asked is None else (Order(order_with, S),)
        rules += () if part_with is None else (Spacing(part_with),)
        bends = spread is not None and (told is not None or rules)
        x = sample(
            partial(_denoise, denoise_segment, M, send(S[None], device)),
            (1, dancers, f, motion_dim),
            abar=abar,
            sampler=sampler,
            steps=steps,
            eta=eta,
            resample=resample,
            clamp=clamp,
            generator=generator,
            x_T=noise[None],
            pin=pin,
            bend=one_after_the_other(
                Bending(spread, told, rules) if bends else None,
                _plant(told, plant_with, known, (dancers, f)),
            ),
            callback=_callback(progress, watch, i, segments),
            device=device,
            dtype=dtype,
        )[0]

        # Segment 0 numbers the dancers from the left; later ones go back from rank to number.
        back = order.argsort()
        if known is None and numbers is None:
            back = left_to_right(root_x(x[:, 0])).cpu()
        x, z = x[back], noise[back]
        if known is not None:
            x = SEAMS[seam](known, x)
        rest = x[:, stride:]
        known = rest[:, : overlap - redo]
        yield x[:, :stride]
    yield rest


def _denoise(denoise_segment: Callable, M: Tensor, S: Tensor, x_t: Tensor, t: int) -> Tensor:
    return denoise_segment(x_t, t, M, S)


def _callback(progress, watch, i: int, segments: int) -> Callable | None:
    """What `sample` calls after every step of segment i."""
    if progress is None and watch is None:
        return None

    def after_step(j: int, steps: int, x0_hat: Tensor) -> None:
        done, total = i * steps + j + 1, segments * steps
        if progress is not None:
            progress(done, total)
        if watch is not None:
            watch(done, total, x0_hat[0])

    return after_step


def _told(
    constraint: Constraint | None, known: Tensor | None, start: int, f: int
) -> Constraint | None:
    """What a segment is told: where it has to set out from, and what the caller asks of it."""
    told = None if constraint is None else constraint.frames(start, start + f)
    if known is None:
        return told
    known = known.cpu()  # as all that bends
    mask = torch.zeros(len(known), f, known.shape[2], dtype=torch.bool)
    value = mask.to(known.dtype)
    k = known.shape[1]
    mask[:, max(0, k - SETS_OUT) : k] = True
    value[:, :k] = known
    here = Constraint(mask, value)
    if told is None:
        return here
    told.mask[:, :k] = False  # they are danced already
    return here.over(told)


def _plant(told, plant_with: Normalizer | None, known: Tensor | None, shape: tuple):
    """How feet are planted in every guess of a segment."""
    if plant_with is None:
        return None
    return Planting(plant_with, **held(told, 0 if known is None else known.shape[1], *shape))


def _orders(
    known: Tensor | None, root_x: Callable, n: int, numbers: Tensor | None
) -> tuple[Tensor, Tensor]:
    """Dancers from left to right where the segment starts, and where the known frames end."""
    if known is None:
        order = torch.arange(n) if numbers is None else numbers
        return order, order
    return left_to_right(root_x(known[:, 0])).cpu(), left_to_right(root_x(known[:, -1])).cpu()


def copy_seam(known: Tensor, x: Tensor) -> Tensor:
    """Keep the known frames exactly; what the network drew there is dropped.

    Shapes: known (n, k, d), x (n, f, d) -> (n, f, d).

    >>> copy_seam(torch.zeros(1, 2, 1), torch.ones(1, 4, 1)).flatten().tolist()
    [0.0, 0.0, 1.0, 1.0]
    """
    return torch.cat([known, x[:, known.shape[1] :]], dim=1)


def fade_seam(known: Tensor, x: Tensor) -> Tensor:
    r"""Cross-fade from the known frames to the network's version of them.

    $$x_f \leftarrow (1 - w_f)\,\text{known}_f + w_f\,x_f, \quad w_f = f / (k - 1)$$

    Source: TCDiff++ "merge"; EDGE's code.  Differs: rotations are blended in 6-D, and become
    rotations again when they are unpacked; the official code takes the arc between them. Both
    versions stay within degrees of each other here, where the two paths are the same.

    Shapes: known (n, k, d), x (n, f, d) -> (n, f, d).

    >>> fade_seam(torch.zeros(1, 3, 1), torch.ones(1, 4, 1)).flatten().tolist()
    [0.0, 0.5, 1.0, 1.0]
    """
    k = known.shape[1]
    w = torch.linspace(0, 1, k, dtype=x.dtype, device=x.device)[:, None]
    return torch.cat([torch.lerp(known, x[:, :k], w), x[:, k:]], dim=1)


HOLDING = ("same_noise", "renoise")  # ways of pinning that hold the known frames
SETS_OUT = 8  # known frames before the seam that say where and how fast a segment sets out
SEAMS = {"copy": copy_seam, "fade": fade_seam}


def _check_options(segments: int, f: int, *, overlap: int, pinning: str, seam: str, targets):
    if segments < 1:
        raise ValueError("segments_music has no segment; give the music of at least one")
    if not 1 <= overlap < f:
        raise ValueError(f"overlap={overlap} must lie in 1 ... {f - 1}: a segment has {f} frames")
    for name, value, known in (("pinning", pinning, MODES), ("seam", seam, SEAMS)):
        if value not in known:
            raise ValueError(f"{name}={value!r} is not one of {', '.join(map(repr, known))}")
    if targets is not None and len(targets) != segments:
        raise ValueError(
            f"target_orders has {len(targets)} entries for {segments} segments; "
            "give one each, None where nothing is asked"
        )


def _check_constraint(constraint, spread, overlap: int, redo: int) -> None:
    if constraint is not None and spread is None:
        raise ValueError("constraint needs spread=, that of the model's training data")
    if not 0 <= redo < overlap:
        raise ValueError(f"redo={redo} must lie in 0 ... {overlap - 1}, some frames must be kept")
