"""Does a test fail where the code is wrong? Faults are put into a copy of the tree, one at a time.

    make mutants                                                # all, with two workers
    python benchmarks/mutants.py --only lodge_eq09_sign         # some of mutants.toml

Each fault's own tests run on a copy of the tree that has it; if all of them pass, it lived. Before
that all these tests must pass without any fault. What was found is kept in out/mutants.json as long
as the fault, its file and its tests stay as they are (``--anew`` forgets it), so that a run that
was stopped goes on. What the tests of a fault said is in out/mutants/NAME.log.
"""

import compileall
import json
import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from hashlib import sha256
from importlib import import_module
from multiprocessing.connection import wait
from pathlib import Path
from py_compile import PycInvalidationMode

import pytest
import tyro

ROOT = Path(__file__).parents[1]
LIST = Path(__file__).with_suffix(".toml")
KEPT = ROOT / "out" / "mutants.json"
SOURCE = "src/dancediff"
PASSED, FAILED, INTERRUPTED = 0, 1, 2  # exit status of pytest: broken imports interrupt it
OPTIONS = "-x -q -p pytest_timeout --timeout=60 -p no:cacheprovider".split()
OPTIONS += ["-o", "addopts=--doctest-modules"]
# What most tests import: once here, instead of once for each fault. Nothing of dancediff.
IMPORTED = "torch einops roma safetensors.torch scipy.signal scipy.optimize librosa"


@dataclass(frozen=True)
class Fault:
    """One change of one file; ``lives`` says why no test sees it, of a fault that stays.

    ``old`` occurs once in the file. ``equation``: such as "Lodge 9". ``tests``: names of test
    files, or of tests in them, that take seconds; the file's own examples always run, too.
    """

    name: str
    file: str
    old: str
    new: str
    breaks: str
    tests: tuple[str, ...]
    equation: str = ""
    lives: str = ""

    @property
    def path(self) -> str:
        """The file, from the root of the tree."""
        return f"{SOURCE}/{self.file}"

    def covering(self) -> list[str]:
        """What pytest is asked to run. Names of test files are unique.

        Raises: StopIteration when there is no such file.
        """
        found = [self.path]
        for test in self.tests:
            name, *inside = test.split("::")
            path = next((ROOT / "tests").rglob(f"{name}.py")).relative_to(ROOT)
            found.append("::".join([path.as_posix(), *inside]))
        return found

    def applied(self, text: str) -> str:
        """The file's text with the fault.

        Raises: ValueError unless ``old`` occurs in it once.
        """
        if (times := text.count(self.old)) != 1:
            raise ValueError(f"{self.name}: old occurs {times} times in {self.file}")
        return text.replace(self.old, self.new)

    def key(self) -> str:
        """Changes with the fault, its file, its tests and what tests share."""
        files: list[str | Path] = [test.split("::")[0] for test in self.covering()]
        files += sorted((ROOT / "tests").glob("*.py"))
        for folder in sorted({(ROOT / file).parent for file in files[1:]}):
            shared = sorted(folder.rglob("*.py"))
            files += [one for one in shared if not one.name.startswith("test_")]
        parts = [repr(self), *((ROOT / file).read_text(encoding="utf-8") for file in files)]
        return sha256("\0".join(parts).encode()).hexdigest()[:16]


def faults_of(path: Path = LIST) -> list[Fault]:
    """All faults of a list."""
    listed = tomllib.loads(path.read_text(encoding="utf-8"))["fault"]
    return [Fault(**one | {"tests": tuple(one["tests"])}) for one in listed]


def copy_tree(folder: Path) -> Path:
    """All files that git knows or would take, as they are; compiled files ask for their hash."""
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, names.split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, folder / name)
    compileall.compile_dir(
        folder / "src", quiet=1, invalidation_mode=PycInvalidationMode.CHECKED_HASH
    )
    return folder


def run_tests(folder: Path, tests: Sequence[str], log: Path) -> None:
    """Run in a process of its own, whose exit status is that of pytest."""
    with log.open("w") as said:
        os.dup2(said.fileno(), 1)
        os.dup2(said.fileno(), 2)
    sys.dont_write_bytecode = True
    sys.path.insert(0, str(folder / "src"))
    os.environ["PYTHONPATH"] = str(folder / "src")
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"  # they take longer than most tests
    os.chdir(folder)
    sys.exit(pytest.main([*OPTIONS, *tests]))


def start(folder: Path, tests: Sequence[str], log: Path) -> multiprocessing.Process:
    """Begin `run_tests` in a fork, which has `IMPORTED` already."""
    process = multiprocessing.get_context("fork").Process(
        target=run_tests, args=(folder, tests, log)
    )
    process.start()
    return process


def tried(faults: list[Fault], folders: list[Path], limit: float) -> Iterator[tuple[Fault, dict]]:
    """Each fault and what became of it, as soon as that is known; a copy of the tree a worker."""
    todo, free, running = list(faults), list(folders), {}
    while todo or running:
        while todo and free:
            fault, folder = todo.pop(0), free.pop()
            sound = (folder / fault.path).read_text(encoding="utf-8")
            (folder / fault.path).write_text(fault.applied(sound), encoding="utf-8")
            process = start(folder, fault.covering(), KEPT.with_suffix("") / f"{fault.name}.log")
            running[process.sentinel] = process, fault, folder, sound, time.monotonic()
        wait(list(running), timeout=1.0)
        for sentinel, (process, fault, folder, sound, begun) in list(running.items()):
            seconds = time.monotonic() - begun
            if process.is_alive() and seconds < limit:
                continue
            process.kill()  # what takes so long does not work either
            process.join()
            (folder / fault.path).write_text(sound, encoding="utf-8")
            del running[sentinel]
            free.append(folder)
            yield fault, {"status": process.exitcode, "seconds": round(seconds, 1)}


def check_sound(folder: Path, faults: list[Fault]) -> None:
    """Without a fault all tests pass; else every fault would seem to be caught."""
    tests = list(dict.fromkeys(test for fault in faults for test in fault.covering()))
    log = KEPT.with_suffix("") / "without_a_fault.log"
    process = start(folder, tests, log)
    process.join()
    if process.exitcode != PASSED:
        raise SystemExit(f"tests fail without any fault: see {log}")


def table(faults: list[Fault], alive: set[str]) -> dict:
    """What docs/results/mutants.json says: a row for each part of the package."""
    rows = []
    for part in sorted({fault.file.split("/")[0] for fault in faults}):
        here = [fault for fault in faults if fault.file.split("/")[0] == part]
        lived = [fault for fault in here if fault.name in alive]
        why = " ".join(f"{one.breaks[:-1]}: {one.lives or 'no test sees it.'}" for one in lived)
        rows.append([f"`{part}`", len(here), len(here) - len(lived), why or None])
    numbers = [len(faults), len(faults) - len(alive), f"{1 - len(alive) / len(faults):.1%} caught"]
    rows.append([{"bold": cell} for cell in ("all", *numbers)])
    count = len({fault.equation for fault in faults} - {""})
    return {
        "about": "Faults put into a copy of the source, and how many made a test fail; "
        f"numbered equations of both papers that have one: {count}.",
        "data": "benchmarks/mutants.toml",
        "date": datetime.now(tz=UTC).date().isoformat(),
        "command": "make mutants",
        "columns": ["part", "faults", "caught", "not caught, and why"],
        "rows": rows,
    }


def main(
    only: tuple[str, ...] = (),
    workers: int = 2,
    limit: float = 300.0,
    anew: bool = False,
    check: bool = True,
    json_file: Path | None = None,
) -> None:
    """Try all faults, or only some of them.

    ``limit``: seconds after which a fault counts as caught. ``check``: first see that all tests
    pass without a fault. ``json_file``: where the table goes.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    faults = [fault for fault in faults_of() if not only or fault.name in only]
    if unknown := set(only) - {fault.name for fault in faults}:
        raise SystemExit(f"{LIST.name} has no {', '.join(sorted(unknown))}")
    KEPT.with_suffix("").mkdir(parents=True, exist_ok=True)
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    keys = {fault.name: fault.key() for fault in faults}
    known = [fault for fault in faults if kept.get(fault.name, {}).get("key") == keys[fault.name]]
    todo = faults if anew else [fault for fault in faults if fault not in known]
    with tempfile.TemporaryDirectory() as made:
        for name in IMPORTED.split():
            with suppress(ImportError):
                import_module(name)
        folders = [copy_tree(Path(made) / str(k)) for k in range(workers if todo else 0)]
        if todo and check:
            check_sound(folders[0], todo)
        for fault, found in tried(todo, folders, limit):
            kept[fault.name] = found | {"key": keys[fault.name]}
            part = KEPT.with_suffix(".part")  # whole or not at all, without importing dancediff
            part.write_text(json.dumps(kept, indent=1))
            part.replace(KEPT)
            print(f"{_word(found):7} {found['seconds']:6.1f} s  {fault.name}", flush=True)
    lived = [fault for fault in faults if _word(kept[fault.name]) == "lived"]
    for fault in lived:
        print(f"lived: {fault.name}, {fault.file}: {fault.breaks} {fault.lives}")
    print(f"{len(faults) - len(lived)} of {len(faults)} caught")
    if missing := [fault.name for fault in faults if _word(kept[fault.name]) == "no test"]:
        raise SystemExit(f"tests not found, of {', '.join(missing)}")
    if json_file is not None:
        text = json.dumps(table(faults, {fault.name for fault in lived}), indent=2)
        json_file.write_text(text + "\n", encoding="utf-8")


def _word(found: dict) -> str:
    """What became of a fault. Tests that cannot be found are a mistake of the list."""
    if found["status"] == PASSED:
        return "lived"
    if found["status"] in (FAILED, INTERRUPTED) or found["status"] < 0:  # < 0: it was stopped
        return "caught"
    return "no test"


if __name__ == "__main__":
    tyro.cli(main)
