r"""Formation prior: a Gaussian over where dancers stand and who moves with whom.

Read first: notebook 07 · `dancediff.extensions.preconditioning`.

Symbols (axes: b batch · n dancers, ranked from left to right · f frames · k frequencies
         c the two coordinates on the floor: root x and root z · N the largest group)
    S          swap mode: S[j] = rank of the dancer who is j-th from the left in the end  (b, n)
    place      where each rank stands, for every size of group                            (N, N, c)
    progress   share of the way to the new place that is done                             (f,)
    basis      principal formations, one a column, for every size and frequency     (N, f, c, N, N)
    std        how far each of them varies                                             (N, f, c, N)
"""

from collections.abc import Iterable

import torch
from torch import Tensor

from dancediff.extensions.group_modes import GroupModes
from dancediff.extensions.parts import Part, Pass
from dancediff.extensions.preconditioning import SMALLEST, dct_matrix
from dancediff.lookup import table
from dancediff.motion.representation import TCDIFFPP


class FormationPrior(Part):
    r"""A Gaussian over the paths of a group, given its size and S.

    $$\mu_r(f) = p_r + w(f)\,\big(p_{S^{-1}(r)} - p_r\big), \qquad
      x_k - \mu_k \sim \mathcal N\big(0,\; U_k \operatorname{diag}(\sigma_k^2)\, U_k^\top\big)$$

    With it the linear guess puts each dancer in place, on the way to the place that S asks for, and
    takes a common step of all as one movement, not as n that happen to agree. Without it the linear
    guess of a place depends on the noise of a single dancer, and the network has to correct it.

    `fit` treats left and right alike, since a mirrored dance is a dance.

    Shapes: see the module's symbols; paths are normalised.

    >>> prior = FormationPrior(max_dancers=2, num_frames=8)
    >>> left, right = torch.zeros(8, 2), torch.ones(8, 2)
    >>> prior.fit([(torch.stack([-right, right])[None], torch.arange(2)[None])])
    >>> prior.mean(torch.tensor([[1, 0]]))[0, :, [0, -1], 0].tolist()
    [[-1.0, 1.0], [1.0, -1.0]]
    """

    place: Tensor
    progress: Tensor
    basis: Tensor
    std: Tensor

    def __init__(self, max_dancers: int, num_frames: int, *, use_swap: bool = True):
        """Until it is fitted everybody stands in the middle and all vary alike.

        ``use_swap``: False for a network without S: everybody is expected to stay.
        """
        super().__init__()
        self.use_swap = use_swap
        N, f = max_dancers, num_frames
        self.register_buffer("place", torch.zeros(N, N, 2))
        self.register_buffer("progress", torch.linspace(0, 1, f))
        self.register_buffer("basis", torch.eye(N).repeat(N, f, 2, 1, 1))
        self.register_buffer("std", torch.full((N, f, 2, N), 0.5))

    @torch.no_grad()
    def fit(self, windows: Iterable[tuple[Tensor, Tensor]]) -> None:
        """Learn from clean windows: paths (w, n, f, c) normalised and ranked, and their S (w, n).

        Every element of the list holds windows of one group size. Sizes that do not occur stay as
        they are.
        """
        groups: dict[int, list[tuple[Tensor, Tensor]]] = {}
        for paths, S in windows:
            groups.setdefault(paths.shape[1], []).append((paths, self.known_order(S)))
        joined = {
            n: (torch.cat([paths for paths, _ in parts]), torch.cat([S for _, S in parts]))
            for n, parts in groups.items()
        }
        for n, (paths, _) in joined.items():
            self.place[n - 1, :n] = _unmoved_by_a_mirror(paths[:, :, 0].mean(0))
        self._fit_progress(joined)
        for n, (paths, S) in joined.items():
            residual = paths - self.mean(S)
            C = table(dct_matrix, residual.shape[2], like=residual)
            residual = torch.cat([residual, _mirrored(residual)])
            waves = torch.einsum("kf,bnfc->kcbn", C, residual).double()
            size, basis = torch.linalg.eigh(waves.mT @ waves / waves.shape[2])
            self.basis[n - 1, :, :, :n, :n] = basis.float()
            self.std[n - 1, :, :, :n] = size.clamp_min(SMALLEST**2).sqrt().float()

    def _fit_progress(self, joined: dict[int, tuple[Tensor, Tensor]]) -> None:
        """Least squares over all who move to another place, frame by frame."""
        along, length = torch.zeros(()), torch.zeros(())
        for n, (paths, S) in joined.items():
            place = self.place[n - 1, :n, 0]
            way = place[S.argsort(1)] - place
            along = along + ((paths[..., 0] - place[:, None]) * way[..., None]).sum((0, 1))
            length = length + way.square().sum()
        if length > 0:
            self.progress.copy_(along / length)

    def mean(self, S: Tensor, f: int | None = None) -> Tensor:
        """Where everybody is expected (b, n, f, c)."""
        place = self.place[self._size(S), : S.shape[1]]
        goal = place.gather(1, S.argsort(1)[..., None].expand(-1, -1, 2))
        w = self.progress[self._rows(f)][:, None]
        return place[:, :, None] + w * (goal - place)[:, :, None]

    def known_order(self, S: Tensor) -> Tensor:
        """S, or the order that never changes where the network has no swap mode."""
        return S if self.use_swap else torch.arange(S.shape[1], device=S.device).expand_as(S)

    def forward(self, S: Tensor, f: int | None = None) -> GroupModes:
        """What preconditioning needs to know about a batch of groups."""
        n, size, rows = S.shape[1], self._size(S), self._rows(f)
        return GroupModes(
            features=TCDIFFPP.floor,
            mean=self.mean(S, f),
            basis=self.basis[size][:, rows, :, :n, :n],
            std=self.std[size][:, rows, :, :n].permute(0, 3, 1, 2),
        )

    def _size(self, S: Tensor) -> Tensor:
        return torch.full((len(S),), S.shape[1] - 1, device=S.device)

    def _rows(self, f: int | None) -> Tensor:
        """Frames, or frequencies, of a shorter window: those it has of the fitted ones."""
        known = len(self.progress)
        f = known if f is None else f
        return (torch.arange(f, device=self.progress.device) * known) // f

    def prepare(self, run: Pass) -> None:
        """Tell preconditioning how this group varies."""
        S = run.conditions.swap
        assert S is not None  # the decoder has checked
        run.group = self(self.known_order(S), run.x_t.shape[2])


def _mirrored(paths: Tensor) -> Tensor:
    """Left becomes right, and the first rank the last (..., n, f, c)."""
    return paths.flip(-3) * paths.new_tensor([-1.0, 1.0])


def _unmoved_by_a_mirror(place: Tensor) -> Tensor:
    """Mean of places (n, c) and their mirror image."""
    return (place + place.flip(0) * place.new_tensor([-1.0, 1.0])) / 2
