r"""What Lodge's stages do with a batch in the training loop, and the discriminator beside them.

Read first: notebook 12 · Lodge section 3.4 · `dancediff.training.objective`.

Symbols (axes: b batch · f frames · d = 139 motion features)
    x_0, x_hat   true and made motion, normalised     (b, f, d)
    z            noise of the style                   (b, z)
    D            the discriminator, whose logits say "real"
"""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from dancediff.diffusion.schedule import send
from dancediff.motion.representation import LODGE
from dancediff.nn.frozen import frozen
from dancediff.nn.losses import compare
from dancediff.papers.lodge.cue_guidance import clean_borders
from dancediff.papers.lodge.genre_discriminator import (
    DiscriminatorConfig,
    GenreDiscriminator,
    PlacedAttention,
)
from dancediff.papers.lodge.global_diffusion import GlobalDenoiser
from dancediff.papers.lodge.local_diffusion import LocalDenoiser
from dancediff.papers.lodge.losses import (
    LodgeWeights,
    l_critic,
    l_diversity,
    l_focus,
    l_genre,
    motion_losses,
)
from dancediff.training.checkpoint import load_extra
from dancediff.training.config import TrainConfig
from dancediff.training.distributed import number_in_process
from dancediff.training.extended_losses import extended_losses
from dancediff.training.objective import Drawn, Objective


class LodgeObjective(Objective):
    """The losses of a stage of Lodge.

    ``border``: in fine-tuning, clean frames at both ends (eq. 10).
    ``discriminator``: adds its terms (eq. 9).
    Raises: TypeError for weights of another model's losses.
    """

    def __init__(
        self,
        model: GlobalDenoiser | LocalDenoiser,
        config: TrainConfig,
        *,
        border: int = 0,
        discriminator: "DiscriminatorTraining | None" = None,
    ):
        super().__init__(model, config)
        if not isinstance(config.weights, LodgeWeights):
            raise TypeError(f"weights={config.weights} are not Lodge's; use LodgeWeights")
        self.weights, self.border, self.discriminator = config.weights, border, discriminator

    def state(self) -> dict[str, Tensor]:
        """Weights and moments of the discriminator, if there is one."""
        return {} if self.discriminator is None else self.discriminator.state()

    def losses(self, model, batch, number: int) -> dict[str, Tensor]:
        """All terms of a `Batch` by name, and their weighted sum "total"."""
        drawn = self.drawn(model, batch, number)
        with self.same_dropout(number):
            terms, x_hat, style = self._compared(model, drawn)
        if self.discriminator is not None and model.training:
            there, generator = drawn.batch, drawn.noised.generator
            x_0, M, genre = there.x, there.M, there.label
            added = self.discriminator.terms(x_hat, x_0, M, genre, number, generator)
            other = style_noise(model, genre, generator)
            if style is not None and other is not None and drawn.z is not None:
                added["diversity"] = l_diversity(drawn.z, other, style, model.style(genre, other))
            weights = {k: getattr(self.weights, k) for k in added if k != "critic"}
            terms["total"] = terms["total"] + sum(w * added[k] for k, w in weights.items())
            terms |= added
        return terms

    @property
    def draws_first(self) -> bool:
        """The discriminator draws."""
        return self.discriminator is None

    def drawn(self, model: Any, batch, number: int) -> Drawn:
        """A `Batch` on the network's device, with noise."""
        batch = self.to_network(batch)
        noised = self.noised(batch.x, number)
        if self.border:
            noised = replace(noised, x_t=clean_borders(noised.x_t, batch.x, self.border))
        z = style_noise(model, batch.label, noised.generator)
        return Drawn(batch, noised, self.conditions(batch, noised), z)

    def compared(self, model: Any, drawn: Drawn) -> dict[str, Tensor]:
        """All terms but the discriminator's, by name, and their weighted sum "total"."""
        terms, *_ = self._compared(model, drawn)
        return terms

    def _compared(
        self, model: Any, drawn: Drawn
    ) -> tuple[dict[str, Tensor], Tensor, Tensor | None]:
        """The terms, the guess and the style tokens."""
        batch, noised = drawn.batch, drawn.noised
        style = None if drawn.z is None else model.style(batch.label, drawn.z)
        conditions = replace(drawn.conditions, style=style)
        with self.autocast():
            guess = model(noised.x_t, noised.t, conditions)
        x_raw, x_hat = guess if isinstance(guess, tuple) else (guess, guess)
        clips = model.clips if isinstance(model, GlobalDenoiser) else lambda x: x
        x_raw, x_hat = x_raw.float(), x_hat.float()
        terms = extended_losses(
            compare(clips(x_raw), clips(x_hat), clips(batch.x), model.normalizer, LODGE),
            partial(motion_losses, relative=self.weights.relative),
            self.weights.terms(),
            extensions=self.config.extensions,
            reconstruction="recon",
            row_weights=noised.weight,
        )
        return terms, x_hat, style


def style_noise(model, genre: Tensor, g: torch.Generator) -> Tensor | None:
    """Noise (b, z) of the style of each row, where the model has any."""
    if model.style is None:
        return None
    return send(torch.randn(len(genre), model.style.noise, generator=g), genre.device)


class DiscriminatorTraining:
    r"""The discriminator with its own optimiser; it learns at every second batch.

    Source: Lodge section 3.4, eq. 9.  Differs: the released code trains it beside the generator in
    every step; alternating (ours) takes half the time, and it learns faster than the generator
    anyway. Of several processes each has its own.

    ``checkpoint``: read its weights and moments from there, if it exists; `state` is what to keep.
    """

    def __init__(
        self,
        config: DiscriminatorConfig,
        *,
        lr: float,
        weight: float = 0.1,
        form: str = "hinge",
        checkpoint: Path | None = None,
        device="cpu",
    ):
        self.D = GenreDiscriminator(config)
        for part in self.D.modules():
            if isinstance(part, PlacedAttention):
                part.places.data.copy_(near(config.num_frames))
        self.D.to(device)
        self.weight, self.form = weight, form
        self.optimizer = torch.optim.AdamW(self.D.parameters(), lr=lr, betas=(0.5, 0.99))
        if checkpoint is not None and checkpoint.exists():
            self._load(load_extra(checkpoint), checkpoint)

    def state(self) -> dict[str, Tensor]:
        """Weights and moments, by name."""
        kept = {f"weights.{k}": v for k, v in self.D.state_dict().items()}
        for i, moments in self.optimizer.state_dict()["state"].items():
            kept |= {f"moments.{i}.{k}": torch.as_tensor(v) for k, v in moments.items()}
        return kept

    def _load(self, kept: dict[str, Tensor], source: Path) -> None:
        weights: dict[str, Tensor] = {}
        moments: dict[int, dict[str, Tensor]] = {}
        for name, value in kept.items():
            kind, key = name.split(".", 1)
            if kind == "weights":
                weights[key] = value
            else:
                i, key = key.split(".", 1)
                moments.setdefault(int(i), {})[key] = value
        try:
            self.D.load_state_dict(weights)
        except RuntimeError as err:
            raise ValueError(f"{source} holds no discriminator of this config: {err}") from err
        groups = self.optimizer.state_dict()["param_groups"]
        self.optimizer.load_state_dict({"state": moments, "param_groups": groups})

    def terms(
        self, x_hat: Tensor, x_0: Tensor, M: Tensor, genre: Tensor, number: int, g: torch.Generator
    ) -> dict[str, Tensor]:
        """Learn, if it is its turn, and say what it thinks of the generator.

        Every batch has the same terms: a log has its columns, and processes average them.
        """
        if number_in_process(number) % 2:
            terms = {"critic": self.learn(x_hat.detach(), x_0, M, genre)}
        else:
            with torch.no_grad():
                terms = {"critic": self.loss(x_hat, x_0, M, genre)}
        with frozen(self.D):  # the generator's gradient goes through it, not into it
            logits = self.D.logits(x_hat, M)
        made = logits.gather(1, genre[:, None])[:, 0]
        terms["genre"] = l_genre(made, form=self.form)
        if logits.shape[1] > 1:
            step = torch.randint(1, logits.shape[1], genre.shape, generator=g).to(genre)
            other = (genre + step) % logits.shape[1]
            terms["focus"] = l_focus(made, logits.gather(1, other[:, None])[:, 0])
        return terms

    def learn(self, x_hat: Tensor, x_0: Tensor, M: Tensor, genre: Tensor) -> Tensor:
        """One step on a true and a made batch."""
        self.optimizer.zero_grad(set_to_none=True)
        loss = self.loss(x_hat, x_0, M, genre)
        (self.weight * loss).backward()
        torch.nn.utils.clip_grad_norm_(self.D.parameters(), 1.0)
        self.optimizer.step()
        return loss.detach()

    def loss(self, x_hat: Tensor, x_0: Tensor, M: Tensor, genre: Tensor) -> Tensor:
        """How badly it tells true dances from made ones."""
        return l_critic(self.D(x_0, M, genre), self.D(x_hat, M, genre), form=self.form)


def near(num_frames: int) -> Tensor:
    r"""Where `PlacedAttention` starts: logits for tokens of about the same frame.

    $$6\,e^{-(f - g)^2 / 8}$$

    From zeros a small discriminator did not learn to tell fast from slow in 300 steps, and from
    these logits it did in 100.

    Shapes: -> (2 f, 2 f), music tokens first.

    >>> near(3)[0].round(decimals=1)
    tensor([6.0000, 5.3000, 3.6000, 6.0000, 5.3000, 3.6000])
    """
    frames = torch.arange(num_frames).repeat(2)
    return 6.0 * torch.exp(-((frames[:, None] - frames) ** 2) / 8)
