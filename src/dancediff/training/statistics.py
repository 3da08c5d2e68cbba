"""What a model knows of its training set before training: scales, and the spectrum of dance.

Read first: notebook 03 · `dancediff.motion.representation.Normalizer`.
"""

import warnings
from collections.abc import Iterator

import torch
from torch import Tensor, nn

from dancediff.data.take import DanceTake
from dancediff.data.windows import GroupCut, half_overlapping
from dancediff.extensions.formation_prior import FormationPrior
from dancediff.extensions.genre_condition import genre_condition_of, genres_of
from dancediff.extensions.genre_prior import GenrePrior
from dancediff.extensions.metre_unit import metre_unit_normalizer
from dancediff.extensions.parts import part_of
from dancediff.extensions.preconditioning import Preconditioning, preconditioning_of
from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import TCDIFFPP, Normalizer
from dancediff.music.features import MusicNormalizer
from dancediff.nn.dance_network import NormalizedNetwork
from dancediff.papers.tcdiff.model import TCDiff
from dancediff.training.config import TrainingExtensions

PLAIN = TrainingExtensions()


def fit_statistics(
    model: NormalizedNetwork,
    takes: list[DanceTake],
    extensions: TrainingExtensions = PLAIN,
    *,
    real: float | None = None,
    mirror: bool = False,
    start: NormalizedNetwork | None = None,
) -> None:
    """Set the scales of motion and music and the spectrum of dance from the takes, once.

    ``mirror``: training sees mirror images, too, so they must be within the scales.
    ``real``: the share of real takes that training will see, see `WindowSampler`.
    ``start``: a model to take the scales from, because its weights go with them.
    """
    if start is not None:
        model.normalizer.load_state_dict(start.normalizer.state_dict())
        model.music_normalizer.load_state_dict(start.music_normalizer.state_dict())
    else:
        ends = torch.cat(list(_ends(takes, mirror)))  # all frames at once would take gigabytes
        unit = extensions.metre_unit
        model.normalizer = metre_unit_normalizer(ends, TCDIFFPP) if unit else Normalizer.fit(ends)
        songs = {M.data_ptr(): M for M in (take.songs[0] for take in takes)}
        model.music_normalizer = MusicNormalizer.fit(list(songs.values()))
    model.music_normalizer = model.music_normalizer.without(extensions.masked_music)
    if isinstance(model, TCDiff):
        model.start.fit(list(_first_places(model, takes)))
    preconditioning = preconditioning_of(model)
    if preconditioning is not None:
        fit_linear_guess(model, preconditioning, takes, real)


def fit_linear_guess(
    model: NormalizedNetwork,
    preconditioning: Preconditioning,
    takes: list[DanceTake],
    real: float | None,
) -> None:
    """Set what the linear guess knows: formations, the spectrum of all dances, that of genres."""
    cut = GroupCut(model.config.num_frames)
    formation = part_of(model, FormationPrior)

    def windows() -> Iterator[tuple[Tensor, Tensor]]:
        for take in takes:
            x, S = half_overlapping(take, cut)
            yield model.normalizer.normalize(x), S

    def around_the_mean() -> Iterator[Tensor]:
        for x, S in windows():
            if formation is not None:
                x[..., TCDIFFPP.floor] -= formation.mean(formation.known_order(S))
            yield x.flatten(0, 1)

    if formation is not None:
        # cloned: a view would keep whole windows, gigabytes of them
        formation.fit((x[..., TCDIFFPP.floor].clone(), S) for x, S in windows())
    frames = [(take.real, take.num_dancers * take.num_frames) for take in takes]
    preconditioning.fit(around_the_mean(), weights=window_weights(frames, real))
    prior = part_of(model, GenrePrior)
    if prior is not None:
        names = genres_of(model)
        genres = [names.index(take.genre) if take.genre in names else None for take in takes]
        known = preconditioning.mean, preconditioning.std
        prior.fit(zip(around_the_mean(), genres, strict=True), *known)


def _ends(takes: list[DanceTake], mirror: bool) -> Iterator[Tensor]:
    """Smallest and largest numbers (2, d) of each take, and of its mirror image."""
    for take in takes:
        for x in (take.x, mirror_features(take.x, TCDIFFPP)) if mirror else (take.x,):
            yield torch.stack([x.amin((0, 1)), x.amax((0, 1))])


def _first_places(model: TCDiff, takes: list[DanceTake]) -> Iterator[Tensor]:
    """Where everybody stands at the beginning of windows, ranked and normalised (w, n, 2)."""
    cut = GroupCut(model.config.num_frames)
    for take in takes:
        x, _ = half_overlapping(take, cut)
        yield model.normalizer.normalize(x[:, :, 0])[..., TCDIFFPP.floor].clone()


def window_weights(takes: list[tuple[bool, int]], real: float | None) -> list[float]:
    """How much a window of each take counts, so that real ones have the share ``real`` together.

    ``takes``: of each take whether it is real, and its number of frames.

    >>> window_weights([(True, 10), (False, 40), (False, 40)], real=0.5)
    [0.05, 0.00625, 0.00625]
    """
    frames = {kind: sum(f for is_real, f in takes if is_real == kind) for kind in (False, True)}
    if real is None or not all(frames.values()):
        return [1.0] * len(takes)
    share = {False: (1 - real) / frames[False], True: real / frames[True]}
    return [share[is_real] for is_real, _ in takes]


def take_over(model: nn.Module, start: nn.Module) -> list[str]:
    """Copy all weights of ``start`` that fit; returns the names of those left new.

    Vectors of genres go by their names. Statistics are not weights: they are fitted on the data, in
    the units of ``start``.

    Raises: ValueError when nothing fits.  Warns when it is less than half of the weights.

    >>> small = nn.Sequential(nn.Linear(2, 3))
    >>> large = nn.Sequential(nn.Linear(2, 3), nn.Linear(3, 1))
    >>> take_over(large, small), bool((large[0].weight == small[0].weight).all())
    (['1.weight', '1.bias'], True)
    """
    mine = dict(model.named_parameters())
    fits = {
        name: value
        for name, value in start.named_parameters()
        if name in mine and mine[name].shape == value.shape
    } | _genre_vectors(model, start)
    if not fits:
        raise ValueError(f"start, a {type(start).__name__}, has no weight of the model's shapes")
    model.load_state_dict(fits, strict=False)
    new = [name for name in mine if name not in fits]
    share = sum(value.numel() for value in fits.values()) / sum(p.numel() for p in mine.values())
    if share < 0.5:
        warnings.warn(
            f"only {share:.1%} of the model's weights fit those of start; {len(new)} tensors, such "
            f"as {new[0]}, begin at random: use the config that start was trained with",
            stacklevel=2,
        )
    return new


def _genre_vectors(model: nn.Module, start: nn.Module) -> dict[str, Tensor]:
    """The model's table of genres, with the vectors of those that ``start`` knows, too."""
    mine, theirs = genre_condition_of(model), genre_condition_of(start)
    if mine is None or theirs is None or mine.table.shape[1] != theirs.table.shape[1]:
        return {}
    table = mine.table.detach().clone()
    for k, genre in enumerate(mine.genres):
        if genre in theirs.genres:
            table[k] = theirs.table[theirs.genres.index(genre)].to(table)
    return {name: table for name, value in model.named_parameters() if value is mine.table}
