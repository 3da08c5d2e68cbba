r"""Pipelines: from a song and a request to a dance.

Read first: notebook 00 · `dancediff.generation.request` · `dancediff.generation.presets`.

    model = dd.load("tcdiffpp")                  # a pipeline
    dance = model.generate(song, dancers=3)
    model.model                                  # its network

Symbols (axes: n dancers · f frames of a piece · F frames of the dance · d motion features)
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, ClassVar

import torch
from torch import Tensor

from dancediff.autoregression.network import AutoregressiveNetwork
from dancediff.axes import FPS
from dancediff.generation.autoregressive_dance import autoregressive_pieces
from dancediff.generation.autoregressive_request import (
    BailandoRequest,
    CoDancersRequest,
    FACTRequest,
    MNETRequest,
)
from dancediff.generation.dance_request import DanceRequest
from dancediff.generation.gcd_dance import gcd_dance
from dancediff.generation.lodge_dance import lodge_pieces, lodge_seams
from dancediff.generation.lodge_request import LodgeRequest
from dancediff.generation.request import request_of
from dancediff.generation.segmented_dance import naive_dance
from dancediff.generation.segmented_request import EDGERequest, GCDRequest, TCDiffRequest
from dancediff.generation.segments import SegmentPlan
from dancediff.generation.steered_dance import SteeredDance
from dancediff.generation.stream import Stream
from dancediff.generation.tcdiff_dance import tcdiff_dance
from dancediff.generation.tcdiffpp_dance import tcdiffpp_pieces
from dancediff.generation.tcdiffpp_request import TCDiffPPRequest
from dancediff.motion.motion import Motion
from dancediff.motion.representation import TCDIFFPP
from dancediff.music.live_song import LiveSong
from dancediff.music.song import as_song, needed_song
from dancediff.nn.conditioning import cached_music
from dancediff.nn.precision import chosen_dtype
from dancediff.papers.bailando.model import Bailando
from dancediff.papers.codancers.model import CoDancers
from dancediff.papers.edge.model import EDGE, moved, start_slots
from dancediff.papers.fact.model import FACT
from dancediff.papers.gcd.model import GCD
from dancediff.papers.lodge.model import Lodge
from dancediff.papers.mnet.model import MNET
from dancediff.papers.tcdiff.model import TCDiff
from dancediff.papers.tcdiffpp.model import TCDiffPP

Network = TCDiffPP | EDGE | GCD | TCDiff | Lodge | AutoregressiveNetwork


class Pipeline(ABC):
    """A network that dances: ``model``, and ``name``, what its dances call it.

    >>> import dancediff as dd
    >>> song, model = dd.packaged_song(), dd.load("tcdiffpp")
    >>> dance = model.generate(song, dancers=2, seconds=8, steps=2)
    >>> [piece.num_frames for piece in model.stream(song, dancers=2, seconds=8, steps=2)]
    [75, 75, 75, 15]
    """

    request: ClassVar[type[DanceRequest]]

    def __init__(self, model: Network, name: str | None = None):
        """Take over a network; where it is and its weights stay as they are."""
        self.model: Any = model  # one of `PIPELINES`
        self.name = name or self.request.family

    @property
    def config(self) -> Any:
        """Sizes and switches of the network."""
        return self.model.config

    def __repr__(self) -> str:
        millions = sum(p.numel() for p in self.model.parameters()) / 1e6
        return f"{type(self).__name__}({self.name!r}, {millions:.1f} million weights)"

    def resolve(self, song, **options) -> DanceRequest:
        """What `generate` would do with these options, nothing left open.

        Raises: ValueError as `generate`.
        """
        request = request_of(self.request.family, self.name, options)
        return request.resolve(self.model, needed_song(song))

    def generate(self, song, *, progress=False, watch: Callable | None = None, **options) -> Motion:
        """Dance to a song.

        - ``song``: a `Music`, or a path.
        - ``options``: those of ``request``; ``preset="paper"`` dances without our additions.
        - ``progress``: True for a bar, or a function (done, total).
        - ``watch``: a function (done, total, guess) that gets to see what TCDiff++ takes the
          segment for after every step, a `Motion` (dancers as the network numbers them); an
          exception it raises stops the dance.

        Raises: ValueError naming the option, its value and what is allowed; also for a silent
        song or one under a second, and for a `LiveSong`, which only `stream` waits for.
        """
        song = as_song(song)
        if isinstance(song, LiveSong):
            raise ValueError("song is a LiveSong, not heard yet; use stream(song), which waits")
        request = self.resolve(song, **options)
        if watch is not None and getattr(request, "long_sampling", None) != "lgds":
            raise ValueError("watch= is for TCDiff++ with long_sampling='lgds' only; leave it out")
        watched = {} if watch is None else {"watch": watch}
        with torch.inference_mode(), self._ready(request, progress) as how:
            x = torch.cat(list(self._pieces(song, request, **how, **watched)), dim=1)
        # cloned: what was made in inference mode could not be used in training
        return self._motion(x[:, : request.frames].clone(), song, request)

    def stream(self, song, *, progress=False, opening: float | None = None, **options) -> Stream:
        """The same dance as `generate`, handed out piece by piece as it is ready; see `Stream`.

        Memory does not grow with the song: what was handed out is forgotten. (Lodge makes a solo
        first and keeps it: 60 MB an hour. EDGE, GCD, TCDiff and ``long_sampling="naive"`` hand out
        the whole dance.) The options are checked at once, the dancing begins with the first piece
        that is asked for.

        ``opening``: so many seconds of the song are enough to begin with. The first dance is then
        danced to music features of that part, which `generate` takes of the whole song.

        Raises: ValueError as `generate`; for ``opening=`` and for a `LiveSong` where the stream
        cannot be steered, because such dances take the whole song.
        """
        return Stream(self, song, options, progress=progress, opening=opening)

    def steered(self, song, request: Any) -> SteeredDance | None:
        """The dance of a stream that can be steered; None where it cannot."""
        return None

    @contextmanager
    def _ready(self, request: DanceRequest, progress) -> Iterator[dict]:
        """Put the network where it shall compute, decide with what digits, report progress."""
        model, was_training = self.model, self.model.training
        device = (
            next(model.parameters()).device
            if request.device is None
            else usable_device(request.device)
        )
        dtype = chosen_dtype(request.dtype, device)
        model.to(device).eval()
        try:
            with cached_music(model), _reported(progress) as report:
                yield {"dtype": dtype, "report": report}
        finally:
            model.train(was_training)

    def _motion(self, x: Tensor, song, request: DanceRequest) -> Motion:
        facts = {"model": self.name, "song": song.name} | request.facts()
        facts["seams"] = self._seams(song, request)
        return Motion.from_features(x, fps=FPS, meta=facts)

    @abstractmethod
    def _pieces(self, song, request: Any, *, report, dtype) -> Iterator[Tensor]:
        """The dance in pieces, features (n, f, d) in metres, on the CPU."""

    @abstractmethod
    def _seams(self, song, request: Any) -> list[int]:
        """Frames in which a segment takes over from the one before; metrics look there."""


class SegmentedPipeline(Pipeline):
    """Models that dance in segments of 5 s."""

    def _seams(self, song, request):
        return SegmentPlan.of(request, self.config.num_frames).seams()


class TCDiffPPPipeline(SegmentedPipeline):
    """TCDiff++: a group whose dancers see each other."""

    request = TCDiffPPRequest

    def _pieces(self, song, request, *, report, dtype, watch=None):
        if request.long_sampling == "naive":
            yield naive_dance(self.model, song, request, report=report, dtype=dtype)
            return
        how = {"report": report, "dtype": dtype}
        yield from tcdiffpp_pieces(self.model, song, request, watch=watch, **how)

    def _seams(self, song, request):
        return SegmentPlan.of(request, self.config.num_frames).seams(request.resampled)

    def steered(self, song, request):
        """None with long_sampling="naive"."""
        return SteeredDance(self.model, song, request) if request.pinning else None


class EDGEPipeline(SegmentedPipeline):
    """EDGE: each dancer alone, then placed side by side; others make no difference to a dancer."""

    request = EDGERequest

    def _pieces(self, song, request, *, report, dtype):
        n, solos = request.dancers, []
        for k in range(n):
            alone = replace(request, dancers=1, seed=request.seed_of(k))
            here = report and (lambda i, total, k=k: report(k * total + i, n * total))
            solos.append(naive_dance(self.model, song, alone, report=here, dtype=dtype, ramp=True))
        x = torch.cat(solos)
        yield moved(x, start_slots(n) - x[:, :1, TCDIFFPP.root])


class GCDPipeline(SegmentedPipeline):
    """GCD: a group whose dancers see each other, all segments at once."""

    request = GCDRequest

    def _pieces(self, song, request, *, report, dtype):
        yield gcd_dance(self.model, song, request, report=report, dtype=dtype)


class TCDiffPipeline(SegmentedPipeline):
    """TCDiff: paths of the whole dance first, then all segments of bodies at once."""

    request = TCDiffRequest

    def _pieces(self, song, request, *, report, dtype):
        yield tcdiff_dance(self.model, song, request, report=report, dtype=dtype)


class LodgePipeline(Pipeline):
    """Lodge: a long solo, which a group can dance together."""

    request = LodgeRequest

    def _pieces(self, song, request, *, report, dtype):
        return lodge_pieces(self.model, song, request, report=report, dtype=dtype)

    def _seams(self, song, request):
        return lodge_seams(self.model, song, request)


class AutoregressivePipeline(Pipeline):
    """Some frames after the other; each dancer alone, unless the network is for groups."""

    def _pieces(self, song, request, *, report, dtype):
        return autoregressive_pieces(self.model, song, request, report=report, dtype=dtype)

    def _seams(self, song, request):
        return []


class FACTPipeline(AutoregressivePipeline):
    """FACT; see `dancediff.papers.fact.model`."""

    request = FACTRequest


class BailandoPipeline(AutoregressivePipeline):
    """Bailando; see `dancediff.papers.bailando.model`."""

    request = BailandoRequest


class MNETPipeline(AutoregressivePipeline):
    """MNET; see `dancediff.papers.mnet.model`."""

    request = MNETRequest


class CoDancersPipeline(AutoregressivePipeline):
    """CoDancers, whose dancers see each other; see `dancediff.papers.codancers.model`."""

    request = CoDancersRequest


PIPELINES: dict[type, type[Pipeline]] = {
    TCDiffPP: TCDiffPPPipeline,
    EDGE: EDGEPipeline,
    GCD: GCDPipeline,
    TCDiff: TCDiffPipeline,
    Lodge: LodgePipeline,
    FACT: FACTPipeline,
    Bailando: BailandoPipeline,
    MNET: MNETPipeline,
    CoDancers: CoDancersPipeline,
}


def pipeline_of(model: Network, name: str | None = None) -> Pipeline:
    """The pipeline for a network.

    Raises: ValueError for a network of no model that dances.

    >>> from dancediff.papers.tcdiffpp.model import TCDiffPPConfig
    >>> pipeline_of(TCDiffPP(TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32)), "tiny").name
    'tiny'
    """
    for kind, pipeline in PIPELINES.items():
        if isinstance(model, kind):
            return pipeline(model, name)
    kinds = ", ".join(kind.__name__ for kind in PIPELINES)
    raise ValueError(f"model is a {type(model).__name__}; give one of {kinds}")


@contextmanager
def _reported(progress) -> Iterator[Callable[[int, int], None] | None]:
    """``progress=`` as a function (done, total) or None: False, True or such a function."""
    if not progress or callable(progress):
        yield progress or None
        return
    from tqdm.auto import tqdm

    with tqdm(desc="dancing", unit="step") as bar:

        def report(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield report


def usable_device(device) -> torch.device:
    """The device of that name.

    Raises: ValueError when it cannot hold a tensor here, in float64 too, as the noise schedule is.

    >>> usable_device("cpu")
    device(type='cpu')
    """
    try:
        found = torch.device(device)
        torch.empty(0, dtype=torch.float64, device=found)
    except (RuntimeError, AssertionError, TypeError) as error:
        raise unusable(device, error) from None
    return found


def unusable(device, why: Exception) -> ValueError:
    """The error for a device that this machine or this torch lacks.

    >>> unusable(torch.device("cuda"), RuntimeError("no driver"))
    ValueError("device='cuda' cannot be used here: no driver; choose 'cpu'")
    """
    name = str(device) if isinstance(device, torch.device) else device
    return ValueError(f"device={name!r} cannot be used here: {why}; choose 'cpu'")
