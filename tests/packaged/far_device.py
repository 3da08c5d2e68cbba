"""A second device made of Python: what a GPU would be asked while a dance is sampled.

    python tests/packaged/far_device.py tcdiffpp '{"dancers": 3}'

Tensors of the device "far" hold one of the CPU; every operation on them passes `run`, which counts
where the program would have to wait for a GPU, and refuses to mix devices as a GPU does. Lists as
indices and tensors made of lists end the program: they are sent anew each time.
"""

import json
import sys
import traceback
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import torch
from torch.utils import backend_registration as backend
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves, tree_map

PACKAGE = f"{Path(find_spec('dancediff').origin).parent}/"  # a clone may be called the same
ASK = {"_local_scalar_dense", "nonzero", "masked_select", "equal", "_unique2", "unique_dim"}
FEW, MORE = 4, 6  # steps of sampling; what is said is the difference
COUNTS = {name: Counter() for name in ("asked", "brought", "sent")}  # by the lines that did it
asked, brought, sent = COUNTS.values()


class Far(torch.Tensor):
    """A tensor of the second device."""

    @staticmethod
    def __new__(cls, near: torch.Tensor):
        how = {"strides": near.stride(), "storage_offset": near.storage_offset()}
        with torch.inference_mode(False):
            return torch.Tensor._make_wrapper_subclass(
                cls, near.shape, dtype=near.dtype, device="far", **how
            )

    def __init__(self, near: torch.Tensor):
        self.near = near

    __torch_function__ = torch._C._disabled_torch_function_impl

    @classmethod
    def __torch_dispatch__(cls, op, types, args=(), kwargs=None):
        return run(op, *args, **(kwargs or {}))


class Watching(TorchDispatchMode):
    """While it is on, tensors can be made on the second device."""

    def __torch_dispatch__(self, op, types, args=(), kwargs=None):
        return run(op, *args, **(kwargs or {}))


class Module(backend._DummyBackendModule):
    def get_amp_supported_dtype(self):
        return [torch.bfloat16]


def near(a):
    if isinstance(a, torch.device):
        return torch.device("cpu")
    return a.near if isinstance(a, Far) else a


def is_far(device) -> bool:
    return device is not None and torch.device(device).type == "far"


def where() -> str:
    """The innermost lines of the library, innermost first."""
    lines = [s for s in traceback.extract_stack() if s.filename.startswith(PACKAGE)]
    return " < ".join(f"{s.filename.removeprefix(PACKAGE)} {s.name}" for s in reversed(lines[-3:]))


def crossing(to_far: bool) -> None:
    (sent if to_far else brought)[where()] += 1


def run(op, *args, **kwargs):
    """One operation, on whatever device its tensors are."""
    name = op._schema.name.removeprefix("aten::")
    composite = torch._C._dispatch_has_kernel_for_dispatch_key(
        op.name(), "CompositeImplicitAutograd"
    )
    if composite and torch.is_inference_mode_enabled():
        with Watching():
            return op.decompose(*args, **kwargs)
    leaves = [a for a in tree_leaves((args, kwargs)) if isinstance(a, torch.Tensor)]
    far = [a for a in leaves if isinstance(a, Far)]
    if name in ("copy_", "_copy_from"):
        goal, source = args[:2] if name == "copy_" else args[1::-1]
        if isinstance(goal, Far) != isinstance(source, Far):
            crossing(isinstance(goal, Far))
        near(goal).copy_(near(source))
        return goal
    if name == "_to_copy" and kwargs.get("device") is not None:
        goes = is_far(kwargs["device"])
        if goes != isinstance(args[0], Far):
            crossing(goes)
        out = op(near(args[0]), **kwargs | {"device": "cpu"})
        return Far(out) if goes else out
    indices = args[1] if name in ("index", "index_put", "index_put_") and far else ()
    for i in indices:
        if i is not None and not isinstance(i, Far):
            sent[where()] += 1
    by_mask = any(i is not None and i.dtype in (torch.bool, torch.uint8) for i in indices)
    if by_mask or (far and name in ASK):
        asked[where()] += 1
    if far and not indices and any(a.ndim for a in leaves if not isinstance(a, Far)):
        raise RuntimeError(f"{name}: all tensors should be on the same device")
    out = op(*tree_map(near, args), **tree_map(near, kwargs))
    known = {id(a.near): a for a in far}
    stays = bool(far) or is_far(kwargs.get("device"))

    def wrapped(a):
        if not isinstance(a, torch.Tensor) or not stays:
            return a
        return known[id(a)] if id(a) in known else Far(a)

    return tree_map(wrapped, out)


def install() -> None:
    """Tell PyTorch of the device, for this process."""
    torch.__future__.set_overwrite_module_params_on_conversion(True)
    backend._setup_privateuseone_for_python_backend("far", Module())
    library = torch.library.Library("_", "IMPL")
    library.fallback(run, "PrivateUse1")
    install.library = library  # or it is gone


def model_of(name: str):
    """A packaged model, or one as the paper has it, small and untrained."""
    from dancediff import hub
    from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

    if name != "paper":
        return hub.load(name)
    from dancediff.generation.pipeline import pipeline_of

    torch.manual_seed(0)
    small = {"d_model": 32, "num_layers": 2, "ff_dim": 64, "fusion_hidden": 32}
    return pipeline_of(TCDiffPP(TCDiffPPConfig(**small)))


def main(name: str, options: str) -> None:
    """One line of JSON: what two more steps on the device ask, and how far off the dance is."""
    from dancediff import hub

    torch.set_num_threads(1)
    model, music = model_of(name), hub.packaged_song()
    options = {"seed": 0, "sampler": "ddim"} | json.loads(options)
    first = model.generate(music, **options, steps=MORE)
    install()
    told = []
    for steps in (FEW, MORE):
        for count in COUNTS.values():
            count.clear()
        with torch.no_grad(), Watching():
            second = model.generate(music, **options, steps=steps, device="far")
        told.append({name: Counter(count) for name, count in COUNTS.items()})
    few, more = told
    difference = (first.joints() - second.joints()).abs().max().item()
    print(json.dumps({k: more[k] - few[k] for k in more} | {"difference": difference}))


if __name__ == "__main__":
    main(*sys.argv[1:])
