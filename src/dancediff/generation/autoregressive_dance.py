r"""From a song and a resolved request to a dance that is made bit by bit.

Read first: `dancediff.autoregression.roll_out`.

Symbols (axes: n dancers · s frames before the first · k frames of a piece · d motion features)
    history   frames before the dance, normalised   (n, s, d)
    x         a piece of it, metres                 (n, k, d)
"""

from collections.abc import Iterator

import torch
from torch import Tensor

from dancediff.autoregression.network import AutoregressiveNetwork
from dancediff.axes import FPS
from dancediff.generation.autoregressive_request import AutoregressiveRequest
from dancediff.motion.motion import Motion
from dancediff.motion.representation import TCDIFFPP, at_origin
from dancediff.papers.edge.model import start_slots

PIECE = 30  # frames that are handed out together


def autoregressive_pieces(
    model: AutoregressiveNetwork, song, request: AutoregressiveRequest, *, report=None, dtype=None
) -> Iterator[Tensor]:
    """A second of the dance at a time, features (n, f, d) in metres, on the CPU."""
    device, total = model.device, request.frames
    generators = [torch.Generator().manual_seed(request.seed_of(k)) for k in range(request.dancers)]
    M = model.music_normalizer.normalize(song.features().to(device))
    history = model.normalizer.normalize(history_of(model, request).to(device))
    noise = torch.stack([torch.randn(history.shape[-1], generator=g) for g in generators])
    rotations = noise[:, None, TCDIFFPP.rot6d].to(device)
    history[..., TCDIFFPP.rot6d] += request.seed_noise * rotations
    kept: list[Tensor] = []
    done = 0
    for new in _computed(model.dance(history, M, request, generators), device.type, dtype):
        kept.append(new.float())
        done += new.shape[1]
        if report is not None:
            report(min(done, total), total)
        if done >= total or sum(x.shape[1] for x in kept) >= PIECE:
            yield model.normalizer.unnormalize(torch.cat(kept, dim=1)).cpu()
            kept = []
        if done >= total:
            return


def _computed(frames: Iterator[Tensor], device: str, dtype) -> Iterator[Tensor]:
    """The same frames, made without gradients and with the digits of ``dtype``.

    Both hold while frames are made, not while they are handed out: they belong to the thread, and
    would hold for what the caller computes meanwhile.
    """
    while True:
        with (
            torch.no_grad(),
            torch.autocast(device, torch.bfloat16, enabled=dtype == torch.bfloat16),
        ):
            new = next(frames, None)
        if new is None:
            return
        yield new


def history_of(model: AutoregressiveNetwork, request: AutoregressiveRequest) -> Tensor:
    """The frames before the dance: those that are asked for, or people who stand in a row.

    Shapes: -> (n, s, d) metres.
    Raises: ValueError when ``seed_motion`` is no dance, too short, at another frame rate, or has
    another number of dancers.
    """
    s, n, seed = model.history_frames, request.dancers, request.seed_motion
    places = torch.zeros(n, 1, TCDIFFPP.dim)
    if seed is None:
        places[..., TCDIFFPP.root] = start_slots(n)
        return model.standing.cpu().expand(n, s, -1) + places
    if not isinstance(seed, Motion):
        raise ValueError(f"seed_motion is a {type(seed).__name__}; give a Motion")
    if seed.num_dancers not in (1, n) or seed.num_frames < s:
        raise ValueError(
            f"seed_motion has {seed.num_dancers} dancers and {seed.num_frames} frames; give 1 or "
            f"{n} dancers and at least {s} frames"
        )
    if seed.fps != FPS:
        raise ValueError(
            f"seed_motion has {seed.fps:g} frames a second, not {FPS}; resample it with "
            "dancediff.data.resample.resample_motion"
        )
    x = seed.features()[:, -s:]
    if seed.num_dancers == n:
        return x
    places[..., TCDIFFPP.root] = start_slots(n)
    return at_origin(x).expand(n, -1, -1) + places
