r"""Both guesses: the reconstruction term is the mean over a guess before and after its feet.

$$\tfrac12\,\lVert x_0 - x_\text{raw} \rVert^2 + \tfrac12\,\lVert x_0 - \hat x \rVert^2$$

TCDiff++ has it on the decoder's guess, Lodge on the refined one. Then the other of the two has no
target of its own: the Footwork Adaptor may move what its other losses do not see, and the Foot
Refine Block may start from anything it likes.
"""

from torch import Tensor

from dancediff.nn.losses import Comparison, mean


def both_guesses(c: Comparison) -> Tensor:
    """The reconstruction term, a scalar; that of a model with one guess is unchanged."""
    return 0.5 * (mean((c.x_raw - c.x_0).square()) + mean((c.x_hat - c.x_0).square()))
