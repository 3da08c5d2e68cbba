r"""Genre prior: the linear guess knows how each genre stands and how far it moves.

Read first: notebook 06 · `dancediff.extensions.preconditioning` ·
`dancediff.extensions.genre_condition`.

Symbols (axes: b batch · g genres, and one row for no genre · f frames · k frequencies · d features)
    w      shares of a mix; what is left of 1 belongs to no genre        (b, g)
    mean   of each feature over the windows of a genre                   (g + 1, d)
    std    standard deviation of each frequency around it                (g + 1, k, d)
"""

from collections.abc import Iterable

import torch
from torch import Tensor

from dancediff.extensions.genre_condition import genre_shares
from dancediff.extensions.parts import Part, Pass
from dancediff.extensions.preconditioning import LARGEST, SMALLEST, dct_matrix
from dancediff.extensions.spectrum import Spectrum
from dancediff.lookup import table

COMMON = 50  # windows of no genre that count in each: a genre of few windows stays near all


class GenrePrior(Part):
    r"""A Gaussian over the windows of each genre; a mix of genres has its mean and variance.

    $$\mu = \sum_g w_g \mu_g, \qquad
      \sigma_k^2 = \sum_g w_g \big(\sigma_{gk}^2 + [k = 0]\, f (\mu_g - \mu)^2\big)$$

    With one mean and one spectrum for all genres the linear guess of every dance leans to what is
    common to them, and the network has to take it back.

    Source: ours.

    Shapes: see the module's symbols; w (b, g) -> mean (b, d), std (b, k, d).

    >>> prior = GenrePrior(genres=2, num_frames=8, dim=1)
    >>> low, high = torch.full((500, 8, 1), -1.0), torch.ones(500, 8, 1)
    >>> prior.fit([(low, 0), (high, 1)], torch.zeros(1), torch.ones(8, 1))
    >>> prior(torch.tensor([[0.5, 0.5], [0.0, 1.0], [0.0, 0.0]])).mean.flatten().round(decimals=1)
    tensor([0.0000, 0.9000, 0.0000])
    """

    mean: Tensor
    std: Tensor

    def __init__(self, genres: int, num_frames: int, dim: int):
        """Until it is fitted all genres are alike."""
        super().__init__()
        self.register_buffer("mean", torch.zeros(genres + 1, dim))
        self.register_buffer("std", torch.full((genres + 1, num_frames, dim), LARGEST))

    @torch.no_grad()
    def fit(self, windows: Iterable[tuple[Tensor, int | None]], mean: Tensor, std: Tensor) -> None:
        """Learn from clean normalised windows (w, f, d) and the number of their genre.

        ``mean``, ``std``: of all windows, (d,) and (k, d), which no genre has.
        """
        f, genres = len(std), len(self.mean) - 1
        common = std.double() ** 2
        common[0] += f * mean.double() ** 2
        count = torch.full((genres,), float(COMMON), dtype=torch.float64)
        total = COMMON * mean.double().repeat(genres, 1)
        power = COMMON * common.repeat(genres, 1, 1)
        for x, genre in windows:
            if genre is not None:
                C = table(dct_matrix, f, like=x)
                count[genre] += len(x)
                total[genre] += x.double().mean(1).sum(0)
                power[genre] += (C @ x).double().square().sum(0)
        means, power = total / count[:, None], power / count[:, None, None]
        power[:, 0] -= f * means**2  # the mean pose is all in frequency 0
        self.mean.copy_(torch.cat([means, mean[None]]))
        spread = power.clamp_min(SMALLEST**2).sqrt()
        self.std.copy_(torch.cat([spread, std[None]]))

    def forward(self, w: Tensor) -> Spectrum:
        """What preconditioning needs to know of each row."""
        w = torch.cat([w, 1 - w.sum(1, keepdim=True)], dim=1)
        # sums, not matrix products: then a row does not depend on how many others there are
        mean = (w[..., None] * self.mean).sum(1)
        power = (w[..., None, None] * self.std**2).sum(1)
        away = (w[..., None] * (self.mean - mean[:, None]) ** 2).sum(1)
        power[:, 0] += len(self.std[0]) * away
        return Spectrum(mean, power.sqrt())

    def prepare(self, run: Pass) -> None:
        """Tell preconditioning how the genre that is asked for stands and moves."""
        run.spectrum = self(genre_shares(run.conditions, len(self.mean) - 1))
