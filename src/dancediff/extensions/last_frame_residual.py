r"""Last-frame residual: guesses of FACT and MNET are added to the last frame that they see.

$$\hat x_{s+i} = \text{valid}(x_s) + f(x_1 \dots x_s,\ M)_i$$

A frame differs little from the one before, and by squared error to repeat it is hard to beat
(lesson 14). A network that writes whole frames errs by some centimetres in each, which a dance on
its own frames shows as shaking and running. Here it begins with standing still, since the last
layer begins at zero, and learns what changes. Places on the floor are seen from the last frame in
the papers' networks already.

A dance on its own frames adds to what was added before. Six numbers of a rotation would leave its
two unit rows bit by bit, contacts and the height of the pelvis their ranges, so all are put back
first. Frames of data are valid: in training this changes nothing.
docs/ablations.md#what-each-addition-brings.

Symbols (axes: b batch · s frames seen · k guessed · w frames of music · d motion features)
    x   the history, normalised                      (b, s, d)
    M   music features                               (b, w, m)
    f   the plain network, which adds x_s's place    (b, k, d)
"""

from collections.abc import Sequence

from torch import Tensor, nn

from dancediff.motion.representation import TCDIFFPP, Normalizer, pack, unpack
from dancediff.papers.fact.model import FACT, FACTConfig
from dancediff.papers.mnet.model import MNET, MNETConfig


def valid(x: Tensor, normalizer: Normalizer) -> Tensor:
    """Frames with rotations that are some, contacts from 0 to 1, and heights as in training.

    Shapes: (..., d) normalised -> the same.

    >>> import torch
    >>> as_it_is = Normalizer(-torch.ones(151), torch.ones(151))
    >>> x = valid(torch.full((151,), 2.0), as_it_is)
    >>> x[:7].tolist(), round(x[7:10].norm().item(), 3)
    ([1.0, 1.0, 1.0, 1.0, 2.0, 1.0, 2.0], 1.0)
    """
    contact, root, pose = unpack(normalizer.unnormalize(x))
    y = normalizer.normalize(pack(contact.clamp(0, 1), root, pose))
    y[..., TCDIFFPP.height] = y[..., TCDIFFPP.height].clamp(-1, 1)
    return y


def on_last_frame(guess: Tensor, history: Tensor, normalizer: Normalizer) -> Tensor:
    """Add the last frame, made valid, but for its place on the floor, which ``guess`` has.

    Shapes: (b, k, d), (b, s, d) -> (b, k, d).

    >>> import torch
    >>> as_it_is = Normalizer(-torch.ones(151), torch.ones(151))
    >>> history = torch.rand(1, 2, 151)
    >>> guess = on_last_frame(torch.zeros(1, 3, 151), history, as_it_is)
    >>> guess[0, 0, 4:7].count_nonzero().item()  # of the root the height
    1
    """
    last = valid(history[:, -1:], normalizer)
    last[..., TCDIFFPP.floor] = 0
    return guess + last


def begin_at_zero(layer: nn.Linear) -> None:
    """Let an untrained layer put out zeros."""
    nn.init.zeros_(layer.weight)
    nn.init.zeros_(layer.bias)


class ExtendedFACT(FACT):
    """FACT with a residual from the last frame; shapes as `FACT`.

    >>> import torch
    >>> sizes = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}
    >>> model = ExtendedFACT(FACTConfig(**sizes), ["last_frame_residual"])
    >>> history = torch.tensor(7 * [0.0] + 24 * [1.0, 0, 0, 0, 1, 0]).expand(2, 60, 151)
    >>> guess = model(history, torch.randn(2, 120, 35))
    >>> torch.allclose(guess, history[:, -1:].expand_as(guess), atol=1e-5)  # it stands still
    True
    """

    def __init__(self, config: FACTConfig, extensions: Sequence[str]):
        super().__init__(config)
        begin_at_zero(self.out)

    def forward(self, history: Tensor, M: Tensor) -> Tensor:
        """What changes, added to the last frame."""
        return on_last_frame(super().forward(history, M), history, self.normalizer)


class ExtendedMNET(MNET):
    """MNET with a residual from the last frame; shapes as `MNET`."""

    def __init__(self, config: MNETConfig, extensions: Sequence[str]):
        super().__init__(config)
        begin_at_zero(self.generator.out)

    def forward(self, history: Tensor, M: Tensor, style: Tensor) -> Tensor:
        """What changes, added to the last frame."""
        return on_last_frame(super().forward(history, M, style), history, self.normalizer)
