r"""Group Dance Decoder (GDD): from a noisy group and a song to a clean guess.

Read first: notebook 10 · TCDiff++ section 4, eq. 8.

Symbols (axes: b batch · n dancers, ranked from left to right · f frames · d motion, m music
features)
    x_t      noisy motion, normalised              (b, n, f, d)
    t        diffusion step                        (b,)
    M, S     music features and swap mode, in `Conditions`
    x_raw    the guess                             (b, n, f, d)
"""

from collections.abc import Callable

import torch
from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions.beat_phase import NUM_WAVES, beat_waves
from dancediff.extensions.foot_cues import NUM_CUES
from dancediff.extensions.formation_prior import FormationPrior
from dancediff.extensions.non_local_filter import NonLocalFilter, left_over
from dancediff.extensions.preconditioning import GroupModes, Preconditioning
from dancediff.nn.batch_invariant import BatchInvariantLinear
from dancediff.nn.decoder import MusicEncoder
from dancediff.nn.timestep import TimestepEncoder
from dancediff.papers.tcdiffpp.dancer_positioning import DancerPositioning
from dancediff.papers.tcdiffpp.fusion_projection import FusionProjection
from dancediff.papers.tcdiffpp.sequence_decoder import SequenceDecoder
from dancediff.papers.tcdiffpp.swap_mode import SwapModeEmbedding


class GroupDanceDecoder(nn.Module):
    r"""The denoiser: $\hat x_r = \text{SD}(\text{FP}(\text{DPE}(W x_t)),\; t, M, S)$.

    Source: TCDiff++ eq. 8 and section 4.2.  Differs: ``docs/differences.md``, 1 to 12; in short,
    dancers are sorted, DPE comes before FP, time has its own axis, and S is used.

    Shapes: see the module's symbols; returns x_raw (b, n, f, d).

    >>> from dancediff.papers.tcdiffpp.model import TCDiffPPConfig
    >>> decoder = GroupDanceDecoder(TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32))
    >>> conditions = Conditions(torch.randn(2, 20, 35), swap=torch.arange(3).expand(2, 3))
    >>> decoder(torch.randn(2, 3, 20, 151), torch.tensor([10, 900]), conditions).shape
    torch.Size([2, 3, 20, 151])
    """

    def __init__(self, config):
        """``config``: a `TCDiffPPConfig`. Its switches dpe, fp and swap_mode remove components."""
        super().__init__()
        c, d = config, config.d_model
        self.max_dancers, self.num_frames = c.max_dancers, c.num_frames
        self.motion_dim, self.music_dim = c.motion_dim, c.music_dim
        self.embed = nn.Linear(c.motion_dim, d)
        self.embed_feet = nn.Linear(NUM_CUES, d) if c.foot_cues else None
        self.embed_beat = nn.Linear(NUM_WAVES, d, bias=False) if c.beat_waves else None
        self.dpe = DancerPositioning(c.max_dancers, d) if c.dpe else None
        self.fp = (
            FusionProjection(c.max_dancers, d, c.fusion_hidden, residual=c.fusion_residual)
            if c.fp
            else None
        )
        self.swap_mode = SwapModeEmbedding(c.max_dancers, d) if c.swap_mode else None
        self.timestep = TimestepEncoder(d)
        self.music = MusicEncoder(
            c.music_dim, d, num_heads=c.num_heads, ff_dim=c.ff_dim, dropout=c.dropout
        )
        self.pooled_music = nn.Sequential(
            nn.LayerNorm(d), BatchInvariantLinear(d, d), nn.SiLU(), BatchInvariantLinear(d, d)
        )
        self.null_music = nn.Parameter(torch.randn(1, c.num_frames, d))
        self.null_pooled = nn.Parameter(torch.randn(1, d))
        self.decoder = SequenceDecoder(
            d,
            num_layers=c.num_layers,
            num_heads=c.num_heads,
            ff_dim=c.ff_dim,
            dropout=c.dropout,
            ssm=c.ssm,
            layer=c.layer,
            d_state=c.d_state,
            expand=c.expand,
            head_dim=c.head_dim,
            bidirectional=c.bidirectional,
        )
        self.out = nn.Linear(d, c.motion_dim)
        self.precondition = self.embed_guess = self.embed_noise = None
        if c.precondition:
            self.precondition = Preconditioning(c.num_frames, c.motion_dim)
            self.embed_guess = nn.Linear(c.motion_dim, d, bias=False)
            self.embed_noise = nn.Linear(c.motion_dim, d, bias=False)
        self.formation = None
        if c.formation_prior:
            if not (c.precondition and c.dpe):
                raise ValueError(
                    "formation_prior=True is a linear guess by rank; set precondition and dpe"
                )
            self.formation = FormationPrior(c.max_dancers, c.num_frames)
        if c.non_local and not c.precondition:
            raise ValueError("non_local=True averages the linear guess; set precondition=True")
        self.non_local = NonLocalFilter(d, c.motion_dim) if c.non_local else None
        self.register_buffer("abar", cosine_abar(c.num_steps).float(), persistent=False)

    def forward(
        self,
        x_t: Tensor,
        t: Tensor,
        conditions: Conditions,
        *,
        foot_cues: Callable[[Tensor], Tensor] | None = None,
    ) -> Tensor:
        """Guess the clean motion of everybody at once.

        ``foot_cues(guess)`` (ours): see that module; needed by a decoder that was built for them.

        Raises: ValueError naming the argument whose shape does not fit.
        """
        M, S, mask = conditions.music, conditions.swap, conditions.music_mask
        self._check(x_t, t, M, S)
        abar, guess, noise = self.abar[t], None, None
        group = self.group_modes(S, x_t.shape[2])
        if self.precondition is not None:
            guess = self.precondition.linear_guess(x_t, abar, group)
            noise = self.precondition.noise(x_t, guess, abar)
        memory, cond = self.conditions(t, conditions)
        h = self.tokens(x_t, guess, noise, foot_cues)
        h = self.hear_beats(h, M, mask)
        start = 0 if self.swap_mode is None else 1
        h = self.decoder(h, memory, cond, music_start=start)
        with torch.autocast(h.device.type, enabled=False):  # millimetres need float32
            x_raw = self.out(h.float())
            if self.precondition is not None:
                x_raw = self.precondition(x_raw, guess, abar, group)
            if self.non_local is not None:
                x_raw = x_raw + self.non_local(h.float(), guess, left_over(x_t, guess, abar))
        return x_raw

    def linear_guess(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """What the preconditioning guesses without any network, (b, n, f, d)."""
        group = self.group_modes(conditions.swap, x_t.shape[2])
        return self.precondition.linear_guess(x_t, self.abar[t].float(), group)

    def group_modes(self, S: Tensor, f: int | None = None) -> GroupModes | None:
        """What is known of the formation: by rank, and by S where the decoder listens to it."""
        if self.formation is None:
            return None
        if self.swap_mode is None:
            S = torch.arange(S.shape[1], device=S.device).expand_as(S)
        return self.formation(S, f)

    def tokens(
        self,
        x_t: Tensor,
        guess: Tensor | None = None,
        noise: Tensor | None = None,
        foot_cues: Callable[[Tensor], Tensor] | None = None,
    ) -> Tensor:
        """Embed the noisy motion, mark the ranks (DPE), mix the dancers (FP).

        ``guess`` and ``noise``: the linear guess and the noise it leaves, embedded beside it when
        the decoder is preconditioned.
        """
        h = self.embed(x_t)
        if guess is not None:
            h = h + self.embed_guess(guess) + self.embed_noise(noise)
        if self.embed_feet is not None:
            h = h + self.embed_feet(foot_cues(x_t if guess is None else guess))
        h = h if self.dpe is None else self.dpe(h)
        h = h if self.fp is None else self.fp(h)
        return h.float()  # the residual stream stays in float32 under autocast

    def hear_beats(self, h: Tensor, M: Tensor, keep: Tensor | None = None) -> Tensor:
        r"""Add to every token how far its frame is between two beats, where the config says so.

        $$h_{nf} \leftarrow h_{nf} + W\,\text{waves}(\varphi_f)$$

        Source: ours. A beat is one number in one of 150 music tokens; that a dance rests on beats
        has to be found out from that through attention alone, which takes thousands of steps.

        Shapes: h (b, n, f, d_model), M (b, f, 35) -> (b, n, f, d_model).
        """
        if self.embed_beat is None:
            return h
        waves = self.embed_beat(beat_waves(M)).float()
        if keep is not None:
            waves = waves * keep[:, None, None]
        return h + waves[:, None]

    def conditions(self, t: Tensor, conditions: Conditions) -> tuple[Tensor, Tensor]:
        """Memory tokens [swap 1, music f, step 2] (b, k, d_model) and FiLM vector (b, d_model)."""
        M, keep = conditions.music, conditions.music_mask
        music = self.music(M)
        pooled = self.pooled_music(music.mean(dim=1))
        if keep is not None:
            null = self.null_music[:, : M.shape[1]]
            music = torch.where(keep[:, None, None], music, null)
            pooled = torch.where(keep[:, None], pooled, self.null_pooled.to(pooled.dtype))
        step, step_tokens = self.timestep(t)
        cond, memory = step + pooled, [music, step_tokens]
        if self.swap_mode is not None:
            swap = self.swap_mode(conditions.swap)
            cond, memory = cond + swap, [swap[:, None], *memory]
        return torch.cat([x.float() for x in memory], dim=1), cond.float()

    def _check(self, x_t: Tensor, t: Tensor, M: Tensor, S: Tensor) -> None:
        b, n, f, d = x_t.shape
        if d != self.motion_dim or not 1 <= n <= self.max_dancers or not 1 <= f <= self.num_frames:
            raise ValueError(
                f"x_t has shape {(b, n, f, d)}; expected (b, n, f, d) with n <= "
                f"{self.max_dancers}, f <= {self.num_frames}, d = {self.motion_dim}"
            )
        expected = {"t": (b,), "M": (b, f, self.music_dim), "S": (b, n)}
        for name, value in (("t", t), ("M", M), ("S", S)):
            if value.shape != expected[name]:
                raise ValueError(
                    f"{name} has shape {tuple(value.shape)}; expected {expected[name]} to match x_t"
                )
