r"""From a TOML file to a trained model: what ``dancediff train`` runs."""

import tomllib
import warnings
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import torch
from torch import Tensor, nn

from dancediff.data.corpus import choreographed_corpus
from dancediff.data.packed import PackedTakes
from dancediff.data.windows import GroupDanceWindows, Take, ranked_windows
from dancediff.extensions.metre_unit import FLOOR_UNIT, MIN_SPAN
from dancediff.motion.representation import TCDIFFPP, Normalizer
from dancediff.music.features import MusicNormalizer
from dancediff.papers.edge.model import EDGE, EDGEConfig, solo_takes
from dancediff.papers.tcdiffpp.losses import LossWeights
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.checkpoint import check_free
from dancediff.training.config import TrainConfig
from dancediff.training.evaluator import Evaluator
from dancediff.training.lodge import is_lodge, train_lodge
from dancediff.training.tables import check_all, kinds_of
from dancediff.training.trainer import Trainer, name_of

MODELS = {"TCDiffPP": (TCDiffPP, TCDiffPPConfig), "EDGE": (EDGE, EDGEConfig)}
_CORPUS = {
    "folder": str, "songs": int, "first_seed": int, "seconds": float, "workers": int,
    "unheard": list,
}  # fmt: skip
_WINDOWS = {
    "dancers_per_batch": int, "mirror": float, "shift": float, "rotate": float, "music": bool,
    "captured": float, "swaps": float,
}  # fmt: skip


def read_config(path) -> dict:
    """Read and check a training config.

    Raises: ValueError naming the file, the table and the key that does not fit.
    """
    return check_tables(read_toml(path), repr(str(path)))


def read_toml(path) -> dict:
    """A TOML file as it is.

    Raises: ValueError naming the file when it is missing or no TOML.
    """
    path = Path(path)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as err:
        raise ValueError(f"config {str(path)!r} does not exist; see configs/") from err
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as err:
        raise ValueError(f"config {str(path)!r} is no TOML file: {err}") from err


def check_tables(config: dict, source: str) -> dict:
    """All tables of a training config; ``class`` in its table ``model`` is a key of `MODELS`.

    Raises: ValueError naming the source, the table and the key that does not fit.
    """
    model = config.get("model", {})
    kind = model.get("class", "TCDiffPP") if isinstance(model, dict) else "TCDiffPP"
    if not isinstance(kind, str) or kind not in MODELS:
        raise ValueError(f"{source}: class {kind!r} is not one of {', '.join(MODELS)}, Lodge")
    known = {
        "data": _CORPUS | _WINDOWS,
        "model": kinds_of(MODELS[kind][1]) | {"class": str},
        "train": kinds_of(TrainConfig),
        "weights": kinds_of(LossWeights),
    }
    del known["train"]["weights"]
    return check_all(config, known, source)


def fit_statistics(
    model: TCDiffPP | EDGE,
    takes: list[Take],
    captured: float | None = None,
    start: nn.Module | None = None,
    unheard: Iterable[str] = (),
) -> None:
    """Set the scales of motion and music and the spectrum of dance from the takes, once.

    ``captured``: the share of captured takes that training will see, see `GroupDanceWindows`.
    ``start``: a model to take the scales from, because its weights go with them.
    ``unheard``: blocks of the music that the model shall be deaf to, see `MusicNormalizer.without`.
    """
    if start is not None:
        model.normalizer.load_state_dict(start.normalizer.state_dict())
        model.music_normalizer.load_state_dict(start.music_normalizer.state_dict())
    else:
        stack = torch.cat([take.x.flatten(0, 1) for take in takes])
        model.normalizer = Normalizer.fit(stack, min_span=MIN_SPAN)
        on_floor = TCDIFFPP.floor
        model.normalizer.low[on_floor], model.normalizer.high[on_floor] = -FLOOR_UNIT, FLOOR_UNIT
        songs = {take.M.data_ptr(): take.M for take in takes}
        model.music_normalizer = MusicNormalizer.fit(list(songs.values()))
    model.music_normalizer = model.music_normalizer.without(unheard)
    if model.decoder.precondition is not None:
        _fit_preconditioning(model, takes, _weights(takes, captured))


def _fit_preconditioning(model, takes: list[Take], weights: list[float]) -> None:
    """The spectrum of dance, around where the formation prior, if there is one, expects it."""
    f, formation = model.config.num_frames, model.decoder.formation

    def windows() -> Iterator[tuple[Tensor, Tensor]]:
        for take in takes:
            x, S = ranked_windows(take.x, f, f // 2)
            yield model.normalizer.normalize(x), S

    if formation is not None:
        formation.fit((x[..., TCDIFFPP.floor], S) for x, S in windows())

    def around_the_mean() -> Iterator[Tensor]:
        for x, S in windows():
            if formation is not None:
                x[..., TCDIFFPP.floor] -= formation.mean(S)
            yield x.flatten(0, 1)

    model.decoder.precondition.fit(around_the_mean(), weights=weights)


def _weights(takes: list[Take], captured: float | None) -> list[float]:
    """How much a window of each take counts, so that captured ones have their share together."""
    frames = {
        kind: sum(t.x[..., 0].numel() for t in takes if t.captured == kind)
        for kind in (False, True)
    }
    if captured is None or not all(frames.values()):
        return [1.0] * len(takes)
    share = {False: 1 - captured, True: captured}
    return [share[take.captured] / frames[take.captured] for take in takes]


def prepared_takes(
    folder, *, num_frames: int = 150, max_dancers: int = 5, split: str = "train"
) -> list[Take]:
    """Takes of a prepared folder that a model can learn from: long and small enough, with music.

    Raises: ValueError when the folder is not prepared, or has no such take.
    """
    takes = PackedTakes(folder, split).takes(num_frames=num_frames, max_dancers=max_dancers)
    if not takes:
        raise ValueError(
            f"{str(folder)!r} has no take in {split!r} with music, {num_frames} frames and at most "
            f"{max_dancers} dancers; prepare more data"
        )
    return takes


def take_over(model: nn.Module, start: nn.Module) -> list[str]:
    """Copy all weights of ``start`` that fit; returns the names of those left new.

    Statistics are not weights: they are fitted on the data, in the units of ``start``.

    Raises: ValueError when nothing fits.

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
    }
    if not fits:
        raise ValueError(f"start, a {type(start).__name__}, has no weight of the model's shapes")
    model.load_state_dict(fits, strict=False)
    return [name for name in mine if name not in fits]


def train_from_config(
    path,
    out,
    *,
    takes: list[Take] | None = None,
    data=None,
    start: nn.Module | None = None,
    preview: Callable | None = None,
    **options,
):
    """Make or read the data, build the model, train it; returns the averaged model.

    - ``data``, else ``folder`` in the config: a prepared folder, whose training split replaces the
      choreographed corpus and whose validation split is evaluated on; ``takes`` does so directly.
      With ``class = "Lodge"`` all of it is up to `dancediff.training.lodge.train_lodge`, and
      ``takes`` are of its class `Solo`.
    - ``start``: a trained model to set out from, see `take_over`; not for Lodge.
    - ``preview(model, step)``: see `dancediff.training.evaluator`.
    - ``options``: ``device``, or a ``world`` that brings its own; ``resume``, ``overwrite``: see
      `dancediff.training.trainer.Trainer`.

    Raises: ValueError for a bad config or folder.
    """
    raw = read_toml(path)
    if is_lodge(raw):
        if start is not None:
            raise ValueError("start is not for Lodge, whose stages are trained one after the other")
        source = repr(str(path))
        return train_lodge(
            raw, out, source=source, solos=takes, data=data, preview=preview, **options
        )
    config = check_tables(raw, repr(str(path)))
    settings = TrainConfig(**config["train"], weights=LossWeights(**config["weights"]))
    model_class, config_class = MODELS[config["model"].pop("class", "TCDiffPP")]
    sizes = config_class(**config["model"])
    check_free(
        Path(out), resume=options.get("resume", False), overwrite=options.get("overwrite", False)
    )
    validation = None
    if takes is None:
        takes, validation = _takes(config["data"], data, sizes, settings)
    torch.manual_seed(settings.seed)
    model = model_class(sizes)
    if isinstance(model, EDGE):
        takes, validation = solo_takes(takes), validation and solo_takes(validation)
    corpus = config["data"]
    fit_statistics(model, takes, corpus.get("captured"), start, corpus.get("unheard", ()))
    if start is not None:
        take_over(model, start)
    windows = _windows(takes, sizes, settings, corpus)
    held_out = _windows(validation, sizes, settings, corpus) if validation else None
    device = options.pop("device", "cpu")
    world = options.get("world")
    model.to(device if world is None else world.device)
    return Trainer(
        model,
        windows,
        settings,
        out,
        evaluator=Evaluator(held_out, settings, preview),
        data_name=name_of(takes, corpus),
        **options,
    ).run()


def _takes(corpus: dict, folder, sizes, settings: TrainConfig) -> tuple[list[Take], list[Take]]:
    """Takes to learn from, and takes to evaluate on where that is wanted."""
    evaluates = settings.evaluate_every > 0
    if folder := folder or corpus.get("folder"):
        limits = {
            "num_frames": sizes.num_frames,
            "max_dancers": getattr(sizes, "max_dancers", 5),
        }
        held_out = PackedTakes(folder, "val").takes(**limits) if evaluates else []
        if evaluates and not held_out:
            warnings.warn(
                f"{str(folder)!r} has no take to evaluate on; prepare more data, or "
                "leave evaluate_every out",
                stacklevel=3,
            )
        return prepared_takes(folder, **limits), held_out
    first, songs = corpus.get("first_seed", 0), corpus.get("songs", 100)
    options = {"seconds": corpus.get("seconds", 30.0), "workers": corpus.get("workers", 2)}
    others = range(first + songs, first + songs + max(2, songs // 10)) if evaluates else ()
    return (
        choreographed_corpus(list(range(first, first + songs)), **options),
        choreographed_corpus(list(others), **options),
    )


def _windows(takes: list[Take], sizes, settings: TrainConfig, corpus: dict) -> GroupDanceWindows:
    options = {key: value for key, value in corpus.items() if key in _WINDOWS}
    return GroupDanceWindows(takes, num_frames=sizes.num_frames, seed=settings.seed, **options)
