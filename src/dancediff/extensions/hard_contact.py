"""Hard contact: in the losses a foot is planted or not, never by half.

The papers multiply a foot's velocity by the predicted contact, so that a contact of 0.4 costs 0.16
of a planted foot's price, and a loss becomes smaller when all contacts do.

Source: EDGE's and TCDiff++'s code, which cut the scaled contact at 0.95.  Differs: the cut is at
0.5 of the contact itself; a dancer who always stands never reaches 0.95 after scaling.
"""

from torch import Tensor

THRESHOLD = 0.5


def hard_contact(contact: Tensor) -> Tensor:
    """1 where a contact is above the threshold, else 0; it has no gradient.

    >>> import torch
    >>> hard_contact(torch.tensor([0.4, 0.6]))
    tensor([0., 1.])
    """
    return (contact > THRESHOLD).to(contact)
