r"""Context: the frames that were danced before, as an input of their own.

Read first: notebook 10 · `dancediff.tcdiffpp.long_group_sampling`.

Symbols (axes: b batch · n dancers · k known frames · f frames of the window · d motion features)
    context  the first k frames of the window, clean and normalised     (b, n, k, d)
    x_t      noisy motion of the whole window                           (b, n, f, d)

Long sampling pins the first frames of a window: at noise level t the network sees them under noise
of level t. Where nearly everything is noise, and a guess decides how everybody will dance, it does
not see them at all. With this input it does, at every level.
"""

import torch
from torch import Tensor, nn
from torch.nn.functional import pad

SHARE = 0.7  # of the training steps that have a context
USUAL = 75  # frames: the overlap of long sampling
USUALLY = 0.6  # share of the contexts that have this length; others are 1 to 4/5 of the window
OWN = 0.5  # share of the contexts that are a guess of the network itself
LOUDEST = 600  # diffusion step up to which such a guess was made from noise


class ContextEmbedding(nn.Module):
    r"""Add to the token of every known frame what is known of it.

    $$h_{nf} \leftarrow h_{nf} + W\,[x_{nf}, 1], \quad f < k$$

    Source: ours. TCDiff++ section 4.4 hands the known frames over in the noise alone (eq. 19), as
    inpainting does in EDGE and Lodge.  W is zero at first: a trained model can be trained on.

    Shapes: context (b, n, k, d), f >= k -> (b, n, f, d_model), zero behind frame k.

    >>> embed = ContextEmbedding(motion_dim=151, d_model=16)
    >>> embed(torch.randn(2, 3, 75, 151), num_frames=150).shape
    torch.Size([2, 3, 150, 16])
    """

    def __init__(self, motion_dim: int, d_model: int):
        super().__init__()
        self.embed = nn.Linear(motion_dim, d_model)
        nn.init.zeros_(self.embed.weight)
        nn.init.zeros_(self.embed.bias)

    def forward(self, context: Tensor, num_frames: int) -> Tensor:
        """What is added to the tokens of a window."""
        return pad(self.embed(context), (0, 0, 0, num_frames - context.shape[2]))


def context_length(num_frames: int, generator: torch.Generator) -> int:
    """How many frames of a training batch are known: often none, mostly `USUAL`, else any number.

    >>> g = torch.Generator().manual_seed(0)
    >>> [context_length(150, g) for _ in range(6)]
    [11, 75, 55, 75, 75, 97]
    """
    has, usual, share = torch.rand(3, generator=generator).tolist()
    if has >= SHARE:
        return 0
    longest = num_frames * 4 // 5
    return min(USUAL, longest) if usual < USUALLY else 1 + int(share * longest)
