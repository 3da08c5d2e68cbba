r"""Non-local filter: denoise a frame with the help of other frames, at full resolution.

Read first: notebook 05 · Buades et al. 2005 (non-local means) ·
`dancediff.extensions.preconditioning`.

Symbols (axes: b batch · n dancers · f, g frames · h heads · d motion features · p parts of a body
         w channels of a head)
    tokens    what the decoder knows of a frame         (b, n, f, d_model)
    guess     the linear guess of x_0, normalised       (b, n, f, d)
    residual  what it leaves of x_t, see `residual_of`  (b, n, f, d)
    A         which frames are averaged, by head        (b, n, h, f, g)
    u, v      how much of it a part of the body takes   (b, n, h, f, p)
"""

import torch
from einops import rearrange
from torch import Tensor, nn

from dancediff.extensions.parts import Part, Pass
from dancediff.nn.attention import rope_angles, rope_frequencies, rotate

HEADS, WIDTH = 6, 16
REACH = (1.5, 2.5, 4.0, 6.0, 10.0, 16.0)  # frames, where training starts


def body_parts(dim: int) -> Tensor:
    """Which part each motion feature belongs to: contacts, root, then joint by joint.

    Shapes: -> (dim,).

    >>> body_parts(151).unique().numel(), body_parts(139)[[0, 5, 7, 13]].tolist()
    (26, [0, 1, 2, 3])
    """
    return torch.tensor([0] * 4 + [1] * 3 + [2 + k // 6 for k in range(dim - 7)])


def residual_of(x_t: Tensor, guess: Tensor, abar: Tensor) -> Tensor:
    r"""What a guess leaves of the noisy motion, less and less as noise takes over.

    $$r = \bar\alpha\,(x_t - \sqrt{\bar\alpha}\,\hat x_0)$$

    Shapes: x_t and guess (b, n, f, d), abar (b,) -> (b, n, f, d).
    """
    abar = abar.reshape(-1, *[1] * (x_t.ndim - 1))
    return abar * (x_t - abar.sqrt() * guess)


class NonLocalFilter(Part):
    r"""Average the linear guess, and what it leaves, over frames that the network chooses.

    $$\Delta_{fc} = \sum_h u_{hfp(c)} \Big(\sum_g A_{hfg}\,\hat x_{gc} - \hat x_{fc}\Big)
      + v_{hfp(c)} \sum_g A_{hfg}\, r_{gc}, \qquad
      A_{hfg} = \underset{g}{\text{softmax}}\Big(\frac{(R_f q_{hf})^\top R_g k_{hg}}{\sqrt w}
      - \frac{|f - g|}{\rho_h}\Big)$$

    A linear filter smooths a rest and a jump alike. Here a dancer who rests is averaged with the
    frames of that rest, and one who moves is left sharp. All features pass at full resolution: the
    network, whose tokens are narrower than a pose, only says which frames and how much.

    Source: after non-local means, with attention for its weights.

    Shapes: see the module's symbols; returns (b, n, f, d), zeros before training.

    >>> filter = NonLocalFilter(16, 151)
    >>> tokens, x = torch.randn(2, 3, 20, 16), torch.randn(2, 3, 20, 151)
    >>> filter(tokens, x, x).abs().max().item()
    0.0
    """

    features: Tensor  # 1 where a feature (column) belongs to a part of the body (row)
    frequencies: Tensor

    def __init__(self, d_model: int, motion_dim: int):
        """Heads start with short and long reaches and take no part."""
        super().__init__()
        self.norm = nn.LayerNorm(d_model)
        self.query_key = nn.Linear(d_model, 2 * HEADS * WIDTH)
        part = torch.arange(2 + (motion_dim - 7) // 6)
        features = (body_parts(motion_dim) == part[:, None]).float()
        self.register_buffer("features", features, persistent=False)
        self.mix = nn.Linear(d_model, 2 * HEADS * len(part))
        for weights in self.mix.parameters():
            nn.init.zeros_(weights)
        self.register_buffer("frequencies", rope_frequencies(WIDTH), persistent=False)
        self.log_reach = nn.Parameter(torch.tensor(REACH).log())

    def weights(self, tokens: Tensor) -> Tensor:
        """A, rows sum to one; (b, n, f, d_model) -> (b, n, h, f, g)."""
        return self._weights(self.norm(tokens))

    def forward(self, tokens: Tensor, guess: Tensor, residual: Tensor) -> Tensor:
        """The correction to add to the guess."""
        tokens = self.norm(tokens)
        A = self._weights(tokens)
        mix = self.mix(tokens).float()
        u, v = rearrange(mix, "... f (two h p) -> two ... h f p", two=2, h=HEADS).unbind()
        with torch.autocast(guess.device.type, enabled=False):  # millimetres need float32
            heads = rearrange(A, "... h f g -> ... (h f) g")  # one product for all of them
            smooth, kept = (
                rearrange(heads @ x, "... (h f) d -> ... h f d", h=HEADS) for x in (guess, residual)
            )
            change = (u @ self.features * smooth + v @ self.features * kept).sum(dim=-3)
            return change - u.sum(dim=-3) @ self.features * guess

    def read(self, x: Tensor, h: Tensor, run: Pass) -> Tensor:
        """As a part of a decoder: x with the correction."""
        return x + self(h, run.guess, residual_of(run.x_t, run.guess, run.abar))

    def _weights(self, tokens: Tensor) -> Tensor:
        both = self.query_key(tokens)
        Q, K = rearrange(both, "... f (two h w) -> two ... h f w", two=2, h=HEADS).float()
        frames = torch.arange(tokens.shape[-2], device=tokens.device)
        angles = rope_angles(frames, self.frequencies)
        away = (frames[:, None] - frames).abs() / self.log_reach.exp()[:, None, None]
        with torch.autocast(tokens.device.type, enabled=False):
            logits = rotate(Q, angles) @ rotate(K, angles).mT / WIDTH**0.5
            return (logits - away).softmax(-1)
