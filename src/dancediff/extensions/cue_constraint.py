r"""Hard cues as a constraint: a hook on Lodge's guesses.

Read first: notebook 12 · `dancediff.extensions.constraint`.

Hard cues are pasted into the noisy motion; the free frames beside them follow the guess, and jump
where that does not meet the cue. With this hook the guess itself is conditioned on the cues, over
all frames at once, and the network sees in its next input where the dance is going.

Symbols (axes: l local segments · f frames · d motion features)
    hard     entries held at every step                    (l, f, d) bool
    y        the cues, normalised                          (l, f, d)
    std      standard deviation of each frequency          (k, d)
"""

from dataclasses import dataclass

from torch import Tensor

from dancediff.extensions.constraint import Constraint


@dataclass(frozen=True)
class SoloConstraintHook:
    """The hook that conditions every guess (l, f, d) on one `Constraint`.

    Differs from `ConstraintHook`: as wide as the linear guess needs; narrower, Lodge's dances were
    no nearer to held-out ones (docs/log/run_15.md).
    """

    constraint: Constraint
    std: Tensor

    def apply(self, x0_hat: Tensor, abar: float) -> Tensor:
        """A guess made where ``abar`` of the signal is left."""
        return self.constraint.condition(x0_hat[None], abar, self.std)[0]


def cue_constraint(hard: Tensor, y: Tensor, std: Tensor) -> SoloConstraintHook:
    """Guesses meet the hard cues.

    >>> hard = torch.zeros(1, 64, 139, dtype=torch.bool)
    >>> hard[:, :4, 7:] = True
    >>> std = (1 / (1 + torch.arange(64.0)[:, None]) ** 2).expand(64, 139)
    >>> hook = cue_constraint(hard, torch.full((1, 64, 139), 0.8), std)
    >>> x = hook.apply(torch.zeros(1, 64, 139), abar=0.5)[0, :, 10]
    >>> bool((x[:4] - 0.8).abs().max() < 1e-3), bool(x.diff().abs().max() < 0.2)
    (True, True)
    """
    return SoloConstraintHook(Constraint(hard.cpu(), y.cpu()), std.cpu())
