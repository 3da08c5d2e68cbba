r"""Group Dance Decoder (GDD): from a noisy group and a song to a clean guess.

Read first: notebooks 07 and 10 · TCDiff++ section 4.1, eq. 8.

Symbols (axes: b batch · n dancers, ranked from left to right · f frames · d motion features)
    x_t      noisy motion, normalised                      (b, n, f, d)
    t        noise level                                   (b,)
    S        swap mode: S[k] = rank at the first frame of the dancer who is k-th from
             the left at the last one, see `dancediff.motion.order`   (b, n)
    h        tokens                                        (b, n, f, d_model)
    x_raw    the guess                                     (b, n, f, d)
"""

import torch
from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.nn.attention import full_precision
from dancediff.nn.conditioning import BatchInvariantLinear, MusicConditioning
from dancediff.nn.decoder import FusionProjection, check_group, check_shapes, read_out
from dancediff.papers.tcdiffpp.sequence_decoder import SequenceDecoder


class DancerPositioning(nn.Module):
    r"""Dancer Positioning Embedding (DPE): one learned vector per left-to-right rank.

    $$h_{n,f} \leftarrow h_{n,f} + e_{\text{rank}(n)}$$

    Dancers arrive sorted by lateral position at the first frame, so the rank is the index.

    Source: TCDiff++ eq. 8 (before the Fusion Projection).  Differs: the paper prints $e \in R^C$,
    one number per dancer; here it is a whole vector.  The released code adds sinusoids after the
    fusion, laid out dancer by dancer on tokens that run frame by frame, with identities drawn at
    random in every call: they carry no left-right information.

    Right before a Fusion Projection without a residual, $W_1(h + e) + b_1 = W_1 h + (b_1 + W_1 e)$:
    for one group size the embedding is part of a bias, and only groups of several sizes learn
    something by it. With `fusion_residual` the tokens themselves are marked.

    Shapes: h (b, n, f, d_model) -> the same.

    >>> dpe = DancerPositioning(max_dancers=5, d_model=8)
    >>> dpe(torch.zeros(1, 3, 2, 8))[0, :, 0].equal(dpe.table[:3])
    True
    """

    def __init__(self, max_dancers: int, d_model: int):
        """Learned: a table (max_dancers, d_model)."""
        super().__init__()
        self.table = nn.Parameter(0.5 * torch.randn(max_dancers, d_model))

    def forward(self, h: Tensor) -> Tensor:
        """The same vector in all frames of a dancer."""
        return h + self.table[: h.shape[1], None]


class SwapModeEmbedding(nn.Module):
    r"""Swap mode S as one vector: a memory token, and a part of the FiLM condition.

    $$e(S) = W\,\text{GELU}\Big(\sum_k E_{k,\,S_k}\Big)$$

    The sum is a linear map of the one-hot sequence: one learned vector per (place, dancer).

    Source: TCDiff++ section 4.1 (through FiLM); the extra memory token is the released code's.
    Differs: paper and code map the indices themselves by a linear layer, so that dancer 4 is four
    times dancer 1; the code never passes S in training or inference.

    Shapes: S (b, n) int -> (b, d_model).

    >>> SwapModeEmbedding(5, 16)(torch.tensor([[1, 0, 2]])).shape
    torch.Size([1, 16])
    """

    def __init__(self, max_dancers: int, d_model: int):
        """Learned: the table E (place, dancer, d_model) and one map."""
        super().__init__()
        self.table = nn.Parameter(torch.randn(max_dancers, max_dancers, d_model) * 0.5)
        self.mlp = nn.Sequential(nn.GELU(), BatchInvariantLinear(d_model, d_model))

    def forward(self, S: Tensor) -> Tensor:
        """See the equation."""
        places = torch.arange(S.shape[-1], device=S.device)
        return self.mlp(self.table[places, S].sum(dim=1))


class NoSwapMode(nn.Module):
    """In the place of `SwapModeEmbedding` where Table 4 leaves it out: zeros for every S."""

    zeros: Tensor

    def __init__(self, d_model: int):
        super().__init__()
        self.register_buffer("zeros", torch.zeros(1, d_model), persistent=False)

    def forward(self, S: Tensor) -> Tensor:
        """Shapes: S (b, n) -> (b, d_model)."""
        return self.zeros.expand(len(S), -1)


class GroupDanceDecoder(MusicConditioning):
    r"""The denoiser: $\hat x_r = \text{SD}(\text{FP}(\text{DPE}(W x_t)),\; t, M, S)$.

    Source: TCDiff++ eq. 8 and section 4.1.  Differs: ``docs/differences.md``, 1 to 12; in short,
    dancers are sorted, DPE comes before FP, time has its own axis, and S is used.

    Shapes: x_t (b, n, f, d), t (b,), conditions with music and swap -> x_raw (b, n, f, d).
    Raises: ValueError naming the argument whose shape does not fit.

    >>> from dancediff.papers.tcdiffpp.model import TCDiffPPConfig
    >>> decoder = GroupDanceDecoder(TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32))
    >>> conditions = Conditions(torch.randn(2, 20, 35), swap=torch.arange(3).expand(2, 3))
    >>> decoder(torch.randn(2, 3, 20, 151), torch.tensor([10, 900]), conditions).shape
    torch.Size([2, 3, 20, 151])
    """

    def __init__(self, config):
        """``config``: a `TCDiffPPConfig`; null modules replace what is in its ``without``."""
        c, d = config, config.d_model
        blocks = {"num_heads": c.num_heads, "ff_dim": c.ff_dim, "dropout": c.dropout}
        super().__init__(d, music_dim=c.music_dim, music_frames=c.num_frames, **blocks)
        self.config = config
        self.embed = nn.Linear(c.motion_dim, d)
        self.dancer_positioning = DancerPositioning(c.max_dancers, d)
        self.fusion_projection = FusionProjection(c.max_dancers, d, c.fusion_hidden)
        self.swap_mode = SwapModeEmbedding(c.max_dancers, d)
        self.sequence_decoder = SequenceDecoder(
            d, num_layers=c.num_layers, with_ssm="ssm" not in c.without, **blocks
        )
        self.out = nn.Linear(d, c.motion_dim)
        if "dancer_positioning" in c.without:
            self.dancer_positioning = nn.Identity()
        if "fusion_projection" in c.without:
            self.fusion_projection = nn.Identity()
        if "swap_mode" in c.without:
            self.swap_mode = NoSwapMode(d)

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """Guess the clean motion of everybody at once."""
        self.check(x_t, t, conditions)
        return self.read(self.decode(self.place(self.embed(x_t)), t, conditions))

    def place(self, h: Tensor) -> Tensor:
        """Mark the ranks (DPE), then mix the dancers (FP)."""
        return full_precision(self.fusion_projection(self.dancer_positioning(h)))

    def decode(self, h: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """Sequence Decoder (SD): features of the clean motion (b, n, f, d_model)."""
        memory, cond = self.memory(t, conditions)
        return self.sequence_decoder(h, memory, cond)

    def memory(self, t: Tensor, conditions: Conditions) -> tuple[Tensor, Tensor]:
        """Memory tokens [swap 1, music f, step 2] (b, k, d_model) and FiLM vector (b, d_model)."""
        music, steps, cond = self.condition(t, conditions)
        swap = full_precision(self.swap_mode(conditions.swap))
        return torch.cat([swap[:, None], music, steps], dim=1), cond + swap

    def read(self, h: Tensor) -> Tensor:
        """From tokens (b, n, f, d_model) to motion (b, n, f, d)."""
        return read_out(self.out, h)

    def check(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> None:
        """Refuse shapes that do not fit."""
        check_group(x_t, self.config)
        (b, n, f, _), c = x_t.shape, self.config
        check_shapes(
            t=(t, (b,)),
            music=(conditions.music, (b, f, c.music_dim)),
            swap=(conditions.swap, (b, n)),
        )
