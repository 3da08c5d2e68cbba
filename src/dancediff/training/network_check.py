"""Does a network of the user's own fit together? Which part does not, and why?

Read first: docs/coursework.md.

One small batch goes through it, beside the plain network of the same sizes: a part that returns
another shape than the plain network's part in its place is named, and so is one that fails.
"""

import torch
from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import build, extensions_of
from dancediff.extensions.genre_condition import genres_of
from dancediff.nn.dance_network import DanceNetwork

BATCH = 2
MOST = 3  # dancers


def check_network(model: DanceNetwork, plain_class: type) -> None:
    """Send a batch through a network; ``plain_class`` is the paper's that it is derived from.

    Raises: ValueError naming the part, what it was given and what it must return.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)  # layers draw their weights from torch's own generator
        plain: DanceNetwork = build(
            plain_class, model.config, extensions_of(model), genres_of(model)
        )
        expected = _Watched(plain)
        expected.run()
        _Watched(model, expected.shapes).run()


class _Watched:
    """A network whose parts are watched: what each returned the first time."""

    def __init__(self, model: DanceNetwork, expected: dict | None = None):
        self.model, self.expected = model, expected
        self.shapes: dict[str, object] = {}
        self.inside: list[tuple[str, nn.Module, object]] = []

    def run(self) -> None:
        model, c = self.model, self.model.config
        n = min(MOST, getattr(c, "max_dancers", MOST))
        g = torch.Generator().manual_seed(0)
        x_t = torch.randn(BATCH, n, c.num_frames, c.motion_dim, generator=g)
        M = torch.randn(BATCH, c.num_frames, c.music_dim, generator=g)
        swap = torch.arange(n).expand(BATCH, n)
        handles = []
        for name, part in model.named_modules():
            handles.append(part.register_forward_pre_hook(self._enter(name)))
            handles.append(part.register_forward_hook(self._leave(name)))
        was_training = model.training
        try:
            with torch.no_grad():
                model.eval()(x_t, torch.tensor([10, 500]), Conditions(M, swap=swap))
        except _Unfit as err:
            raise ValueError(str(err)) from None
        except Exception as err:
            name, part, given = self.inside[-1] if self.inside else ("", model, "")
            raise ValueError(
                f"{_called(name, part)} fails on {given}: {type(err).__name__}: {err}"
            ) from err
        finally:
            model.train(was_training)
            for handle in handles:
                handle.remove()

    def _enter(self, name: str):
        def hook(part, given):
            self.inside.append((name, part, _shapes(given)))

        return hook

    def _leave(self, name: str):
        def hook(part, given, returned):
            self.inside.pop()
            first = name not in self.shapes
            self.shapes.setdefault(name, _shapes(returned))
            if first and self.expected is not None and name in self.expected:
                found, wanted = self.shapes[name], self.expected[name]
                if found != wanted:
                    raise _Unfit(
                        f"{_called(name, part)} returns {found} for {_shapes(given)}; "
                        f"the network needs {wanted} there"
                    )

        return hook


class _Unfit(Exception):
    """A part returned another shape than it must."""


def _called(name: str, part: nn.Module) -> str:
    where = f"part {name!r} ({type(part).__name__})" if name else f"network {type(part).__name__}"
    return f"the {where}"


def _shapes(x) -> object:
    """Shapes of all tensors in what a part was given or returned."""
    if isinstance(x, Tensor):
        return tuple(x.shape)
    if isinstance(x, tuple | list):
        found = tuple(_shapes(one) for one in x)
        return found[0] if len(found) == 1 else found
    return type(x).__name__
