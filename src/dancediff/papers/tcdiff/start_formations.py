r"""Where groups stand when a song begins.

Symbols (axes: n dancers, ranked from left to right · N the largest group)
    place    mean place of each rank, for every size of group, normalised x and z    (N, N, 2)
    std      its standard deviation                                                  (N, N, 2)
"""

import torch
from torch import Tensor, nn

from dancediff.diffusion.schedule import Generators, gaussian


class StartFormations(nn.Module):
    """Places of groups of each size, fitted on the first frames of training windows.

    TCDiff begins with 100 true frames of the test set and does not say how a new song begins.

    >>> start = StartFormations(max_dancers=2)
    >>> start.fit([torch.tensor([[[-1.0, 0.0], [1.0, 0.0]]])])
    >>> start(2, 1, torch.Generator()).tolist()
    [[[-1.0, 0.0], [1.0, 0.0]]]
    """

    place: Tensor
    std: Tensor

    def __init__(self, max_dancers: int):
        super().__init__()
        self.register_buffer("place", torch.zeros(max_dancers, max_dancers, 2))
        self.register_buffer("std", torch.zeros(max_dancers, max_dancers, 2))

    @torch.no_grad()
    def fit(self, places: list[Tensor]) -> None:
        """From groups (w, n, 2), each element of one size; sizes that do not occur stay."""
        for n in {one.shape[1] for one in places}:
            here = torch.cat([one for one in places if one.shape[1] == n])
            self.place[n - 1, :n] = here.mean(0)
            self.std[n - 1, :n] = here.std(0, correction=0)

    def forward(self, n: int, rows: int, generator: Generators = None) -> Tensor:
        """Groups of n dancers at random, (rows, n, 2).

        Raises: ValueError for a size that other sizes were fitted without: all would be at one
        point, and stay there.
        """
        fitted = torch.cat([self.place, self.std], dim=1).flatten(1).any(1)
        known = [k + 1 for k, one in enumerate(fitted.tolist()) if one]
        if n > 1 and known and n not in known:
            raise ValueError(f"dancers={n}: no such group was learned from; ask for {known}")
        noise = gaussian((rows, n, 2), generator=generator, device=self.place.device)
        return self.place[n - 1, :n] + self.std[n - 1, :n] * noise
