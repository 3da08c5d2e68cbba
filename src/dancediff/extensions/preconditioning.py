r"""Preconditioning: start from the best linear guess and let the network add what it lacks.

Read first: notebooks 06 and 07 · Karras et al. 2022 (EDM) section 5 and eq. 7.

Symbols (axes: b batch · n dancers · f frames · k frequencies, as many as frames · d features)
    x_t      noisy motion, normalised; n only of groups   (b, n, f, d)
    F        what the network puts out                    (b, n, f, d)
    abar     signal power left                            (b,)
    mean     of each feature over the training set        (d,)
    std      standard deviation of each frequency         (k, d)
    skip     share of x_t that is kept                    (b, 1 or n, k, d)
    scale    size of the network's part                   (b, 1 or n, k, d)

Dance is smooth: its slow parts are large and its fast parts tiny, while noise is as large at one
frequency as at another. So the best linear guess (Wiener's filter) keeps the slow parts of x_t and
drops the fast ones, and what is left to add is smooth, too. The frequencies are those of a
discrete cosine transform over the frames, which needs no periodic motion.
"""

import math
from collections.abc import Iterable
from itertools import repeat

import torch
from torch import Tensor, nn

from dancediff.extensions.group_modes import GroupModes
from dancediff.extensions.parts import Part, Pass, part_of
from dancediff.extensions.spectrum import Spectrum
from dancediff.lookup import table

LARGEST = 0.5  # of `scale`: the slow parts of F stay in the units of the motion
SMALLEST = 2e-4  # of `std`: a feature that never moved can still be corrected


def dct_matrix(f: int) -> Tensor:
    r"""Orthonormal DCT-II over f frames, one frequency a row.

    $$C_{kj} = \sqrt{\tfrac{2 - \delta_{k0}}{f}}\, \cos\frac{\pi k (2j + 1)}{2f}$$

    Shapes: -> (f, f); row k turns k half-waves in f frames.

    >>> C = dct_matrix(8)
    >>> torch.allclose(C @ C.T, torch.eye(8), atol=1e-6)
    True
    """
    k, j = torch.arange(f, dtype=torch.float64)[:, None], torch.arange(f, dtype=torch.float64)
    C = torch.cos(math.pi * k * (2 * j + 1) / (2 * f)) * math.sqrt(2 / f)
    C[0] /= math.sqrt(2)
    return C.float()


def linear_coefficients(abar: Tensor, std: Tensor) -> tuple[Tensor, Tensor]:
    r"""How much of the noisy motion to keep, and how far off that guess is.

    $$c_\text{skip} = \frac{\sqrt{\bar\alpha}\,\sigma^2}{v}, \quad
      c_\text{out} = \sigma \sqrt{\frac{1 - \bar\alpha}{v}},
      \quad v = \bar\alpha\sigma^2 + 1 - \bar\alpha$$

    Source: EDM eq. 7, for an x_0 of std $\sigma$ under $\sqrt{\bar\alpha} x_0 +
    \sqrt{1 - \bar\alpha}\,\epsilon$.

    Shapes: abar and std broadcast -> both like them.

    >>> [c.item() for c in linear_coefficients(torch.tensor(1.0), torch.tensor(0.5))]  # no noise
    [1.0, 0.0]
    >>> [c.item() for c in linear_coefficients(torch.tensor(0.0), torch.tensor(0.5))]  # only noise
    [0.0, 0.5]
    """
    v = abar * std**2 + (1 - abar)  # in this order: 1 would swallow a small std
    return abar.sqrt() * std**2 / v, std * ((1 - abar) / v).sqrt()


class Preconditioning(nn.Module):
    r"""From the network's output to a guess of x_0, one frequency at a time.

    $$\hat x_0 = \mu + C^\top\big(c_\text{skip}\, C (x_t - \sqrt{\bar\alpha}\,\mu)
      + \min(c_\text{out}, \tfrac12)\, C F\big)$$

    Source: after EDM.  Differs: EDM has one std for all data, the papers let the network
    output x_0 itself. With one std the network must cancel the noise of every feature in every
    frame, which is more numbers than a narrow network can carry; the dances tremble.

    Shapes: see the module's symbols.

    >>> precondition = Preconditioning(num_frames=150, dim=151)  # not fitted: all frequencies alike
    >>> x_t, abar = torch.randn(2, 3, 150, 151), torch.tensor([0.9, 0.1])
    >>> guess = precondition.linear_guess(x_t, abar)
    >>> torch.equal(guess, precondition(torch.zeros_like(x_t), guess, abar))
    True
    """

    mean: Tensor
    std: Tensor

    def __init__(self, num_frames: int, dim: int):
        super().__init__()
        self.register_buffer("mean", torch.zeros(dim))
        self.register_buffer("std", torch.full((num_frames, dim), LARGEST))

    @torch.no_grad()
    def fit(self, windows: Iterable[Tensor], weights: Iterable[float] | None = None) -> None:
        """Take mean and std from clean normalised windows, in pieces (w, f, d).

        ``weights``: how much a window of each piece counts; by default all count the same.
        """
        mean, power, count = torch.zeros(()), torch.zeros(()), 0.0
        for x, weight in zip(windows, weights or repeat(1.0), strict=weights is not None):
            C = table(dct_matrix, x.shape[1], like=x)
            mean = mean + weight * x.double().mean(1).sum(0)
            power = power + weight * (C @ x).double().square().sum(0)
            count += weight * len(x)
        mean, power = mean / count, power / count
        power[0] -= x.shape[1] * mean**2  # the mean pose is all in frequency 0
        self.mean.copy_(mean)
        self.std.copy_(power.clamp_min(SMALLEST**2).sqrt())

    def linear_guess(
        self,
        x_t: Tensor,
        abar: Tensor,
        group: GroupModes | None = None,
        known: Spectrum | None = None,
    ) -> Tensor:
        """What can be said without a network, like x_t.

        ``group``: how its dancers vary together; ``known``: of each row, in place of mean and std.
        """
        skip, _ = self._coefficients(x_t, abar, group, known)
        C = table(dct_matrix, x_t.shape[-2], like=x_t)
        mean = self.mean if known is None else _each_row(known.mean, x_t)
        mean = mean if group is None else group.placed(mean)
        noisy = x_t - _each_row(abar, x_t).sqrt() * mean
        with torch.autocast(x_t.device.type, enabled=False):  # millimetres need float32
            return mean + C.T @ _scaled(skip, C @ noisy, group)

    def noise(self, x_t: Tensor, guess: Tensor, abar: Tensor) -> Tensor:
        r"""The noise there is in x_t if a guess is right: an additional input of the network.

        $$\hat\epsilon = \frac{x_t - \sqrt{\bar\alpha}\,\hat x_0}{\sqrt{1 - \bar\alpha}}$$

        In x_t itself it is a thousandth beside the motion where there is little noise; in bfloat16,
        with its three digits, nothing of it is left.

        Shapes: x_t and guess (b, n, f, d), abar (b,) -> (b, n, f, d).
        """
        abar = _each_row(abar, x_t)
        return (x_t - abar.sqrt() * guess) / (1 - abar).sqrt()

    def forward(
        self,
        F: Tensor,
        guess: Tensor,
        abar: Tensor,
        group: GroupModes | None = None,
        known: Spectrum | None = None,
    ) -> Tensor:
        """Add the network's part F to the linear guess."""
        _, scale = self._coefficients(F, abar, group, known)
        C = table(dct_matrix, F.shape[-2], like=F)
        with torch.autocast(F.device.type, enabled=False):
            return guess + C.T @ _scaled(scale.clamp_max(LARGEST), C @ F, group)

    def error(self, abar: Tensor) -> Tensor:
        """Mean square of what the linear guess misses, where the training set's std is right.

        Shapes: abar (b,) -> (b,).
        """
        return linear_coefficients(abar[:, None, None], self.std)[1].square().mean((1, 2))

    def _coefficients(
        self, x: Tensor, abar: Tensor, group: GroupModes | None, known: Spectrum | None
    ) -> tuple[Tensor, Tensor]:
        # A shorter window knows fewer frequencies: take those it has from the fitted ones.
        rows = (torch.arange(x.shape[-2], device=x.device) * len(self.std)) // x.shape[-2]
        std = self.std if known is None else _each_row(known.std, x)
        std = std[..., rows, :]
        if group is not None:
            std = group.std_with_modes(std)
        return linear_coefficients(_each_row(abar, x), std)


def _scaled(by: Tensor, coefficients: Tensor, group: GroupModes | None) -> Tensor:
    if group is None:
        return by * coefficients
    return group.turn_back(by * group.turn(coefficients))


def _each_row(known: Tensor, x: Tensor) -> Tensor:
    """What is known of each row, (b,), (b, d) or (b, k, d), with as many axes as x."""
    return known.reshape(len(known), *[1] * (x.ndim - known.ndim), *known.shape[1:])


class LinearStart(Part):
    """Preconditioning as a part: the network reads the linear guess and adds to it.

    What the Footwork Adaptor changes passes through it as well, so that it is as smooth as dance is
    and no more than the noise can hide.
    """

    def __init__(self, d_model: int, motion_dim: int, num_frames: int):
        super().__init__()
        self.preconditioning = Preconditioning(num_frames, motion_dim)
        self.embed_guess = nn.Linear(motion_dim, d_model, bias=False)
        self.embed_noise = nn.Linear(motion_dim, d_model, bias=False)

    def prepare(self, run: Pass) -> None:
        """Make the linear guess."""
        run.guess = self.preconditioning.linear_guess(run.x_t, run.abar, run.group, run.spectrum)

    def embed(self, h: Tensor, run: Pass) -> Tensor:
        """The guess, and the noise that it leaves, beside the noisy motion."""
        noise = self.preconditioning.noise(run.x_t, run.guess, run.abar)
        return h + self.embed_guess(run.guess) + self.embed_noise(noise)

    def read(self, x: Tensor, h: Tensor, run: Pass) -> Tensor:
        """What the decoder put out, added to the guess."""
        return self.preconditioning(x, run.guess, run.abar, run.group, run.spectrum)

    def adapt(self, x_hat: Tensor, x_raw: Tensor, run: Pass) -> Tensor:
        """The adaptor's change, added to x_raw."""
        return self.preconditioning(x_hat - x_raw, x_raw, run.abar, run.group, run.spectrum)


def preconditioning_of(model: nn.Module) -> Preconditioning | None:
    """That of a model or of a part of it; None where there is none."""
    return part_of(model, Preconditioning)
