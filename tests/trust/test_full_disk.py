"""The disk is full, or may not be written: commands say so, and what was there stays as it was."""

import contextlib
import io
import os
import re
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from tiny_training import tiny_config

from dancediff import cli
from dancediff.arrays import read_arrays

resource = pytest.importorskip("resource", reason="limits on files are of Unix")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
FORMATS = "npz,png,html,glb,bvh,smpl"
DANCE = f"generate packaged --seconds 2 --steps 1 --formats {FORMATS} --out OUT"
EARLIER = {  # made the folder as it is, and would write more into it or over it
    "train": ("train 6.toml --out OUT", "train 12.toml --resume --out OUT"),
    "prepare": ("prepare choreograph 2 OUT --seconds 5", "prepare choreograph 4 OUT --seconds 5"),
    "generate": (f"{DANCE} --seed 0", f"{DANCE} --seed 1"),
}
# bytes a file may have: less than a checkpoint, a take, the largest of a dance's files
LIMITS = {"train": 20_000, "prepare": 150_000, "generate": 400_000}


def words(text: str, out: Path, configs: Path) -> list[str]:
    text = re.sub(r"(\d+\.toml)", rf"{configs}/\1", text)
    return [str(out) if word == "OUT" else word for word in text.split()]


@pytest.fixture(scope="module")
def configs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("configs")
    for steps in (6, 12):
        (folder / f"{steps}.toml").write_text(tiny_config(steps, 3))
    return folder


@pytest.fixture(scope="module", params=EARLIER)
def earlier(request, configs, tmp_path_factory):
    """What an earlier run left, while there was room."""
    out = tmp_path_factory.mktemp(request.param) / "out"
    with contextlib.redirect_stdout(io.StringIO()):
        assert cli.main(words(EARLIER[request.param][0], out, configs)) == 0
    return request.param, out


def content(folder: Path) -> dict[str, bytes]:
    """All files and their bytes, hidden ones too."""
    found = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


def run_again(name: str, out: Path, configs: Path, limit: int | None = None):
    """The later command in a process of its own, and what it said last."""

    def lower():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    done = subprocess.run(
        [sys.executable, "-m", "dancediff.cli", *words(EARLIER[name][1], out, configs)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        timeout=300,
        check=False,
        preexec_fn=None if limit is None else lower,
    )
    lines = [line for line in re.split(r"[\r\n]", done.stderr) if line.strip()]
    assert "Traceback" not in done.stderr
    return done.returncode, lines[-1] if lines else ""


def check_kept(name: str, before: dict[str, bytes], out: Path) -> int:
    """Old files are as they were, new ones whole, nothing is left half-written."""
    after = content(out)
    assert before and before.keys() <= after.keys()
    for file, data in before.items():
        if name == "train" and file == "losses.csv":  # steps are added to it one by one
            assert after[file].startswith(data)
        else:
            assert after[file] == data, file
    for file in after.keys() - before.keys():
        assert not any(part.startswith(".") for part in Path(file).parts), file
        assert file.endswith(".npz"), file
        assert read_arrays(out / file)
    return len(before)


@contextlib.contextmanager
def memory_disk(folder: Path):
    """A small disk of its own at ``folder``; who may not mount one is skipped."""
    folder.mkdir()
    if not sys.platform.startswith("linux") or os.geteuid() != 0 or not shutil.which("mount"):
        pytest.skip("only root on Linux can mount a tmpfs")
    how = ["mount", "-t", "tmpfs", "-o", "size=16m,mode=755", "tmpfs", str(folder)]
    mounted = subprocess.run(how, capture_output=True, text=True, check=False)
    if mounted.returncode:
        pytest.skip(f"no tmpfs can be mounted here: {mounted.stderr.strip()}")
    try:
        yield folder
    finally:
        if subprocess.run(["umount", str(folder)], check=False).returncode:
            subprocess.run(["umount", "-l", str(folder)], check=True)


def fill(file: Path) -> None:
    """Write until nothing more fits."""
    with file.open("wb", buffering=0) as stream, contextlib.suppress(OSError):
        while True:
            stream.write(b"\0" * 4096)


def test_files_may_not_grow(earlier, configs, tmp_path, record_property):
    name, old = earlier
    out = shutil.copytree(old, tmp_path / "out")
    before = content(out)
    status, said = run_again(name, out, configs, LIMITS[name])
    assert status == 2
    assert said.startswith("dancediff: ") and "too large" in said and "free space" in said
    assert str(out) in said
    kept = check_kept(name, before, out)
    record_property("trust", f"files limited to {LIMITS[name]:,} bytes, {name}: {kept} files kept")


def test_the_disk_is_full(earlier, configs, tmp_path, record_property):
    name, old = earlier
    with memory_disk(tmp_path / "disk") as disk:
        out = shutil.copytree(old, disk / "out")
        before = content(out)
        fill(disk / "filler")
        assert shutil.disk_usage(disk).free == 0
        status, said = run_again(name, out, configs)
        assert status == 2
        assert said.startswith("dancediff: ") and "No space left" in said and "free space" in said
        assert str(out) in said
        kept = check_kept(name, before, out)
        (disk / "filler").unlink()  # once there is room, the same command works
        status, _ = run_again(name, out, configs)
        assert status == 0 and before != content(out)
    record_property("trust", f"a full disk, {name}: {kept} files kept, and done when there is room")


def check_refused(name: str, out: Path, configs: Path, why: str) -> int:
    before = content(out)
    status, said = run_again(name, out, configs)
    assert status == 2
    assert said.startswith("dancediff: ") and str(out) in said and why in said
    assert "name another folder" in said
    return check_kept(name, before, out)


def test_the_folder_may_not_be_written(earlier, configs, tmp_path, record_property):
    name, old = earlier
    if os.geteuid() == 0:  # who may do everything is only stopped by the disk
        with memory_disk(tmp_path / "disk") as disk:
            out = shutil.copytree(old, disk / "out")
            subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
            kept = check_refused(name, out, configs, "Read-only file system")
    else:
        out = shutil.copytree(old, tmp_path / "out")
        out.chmod(0o555)
        try:
            kept = check_refused(name, out, configs, "Permission denied")
        finally:
            out.chmod(0o755)
    record_property("trust", f"a folder that cannot be written, {name}: {kept} files kept")


def test_a_take_that_is_made_anew_stays_until_the_new_one_is_there(tmp_path):
    out = tmp_path / "out"
    with contextlib.redirect_stdout(io.StringIO()):
        assert cli.main(["prepare", "choreograph", "2", str(out), "--seconds", "5"]) == 0
    before = content(out)
    again = [sys.executable, "-m", "dancediff.cli", "prepare", "choreograph", "2", str(out)]
    for limit in (300, 20_000):
        lower = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (limit, limit))
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
        words = [*again, "--seconds", "6"]
        done = subprocess.run(words, check=False, preexec_fn=lower, timeout=300, **quiet)
        assert done.returncode == 2 and str(out) in done.stderr.decode()
        assert before.items() <= content(out).items()
