import shutil
import subprocess
import tomllib

import pytest
import yaml

import dancediff
from places import ROOT

SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = SETTINGS["project"]


def test_wheel_holds_every_file_that_is_no_code():
    source = ROOT / "src" / "dancediff"
    globs = SETTINGS["tool"]["setuptools"]["package-data"]["dancediff"]
    packed = {path for glob in globs for path in source.glob(glob)}
    files = {p for p in source.rglob("*") if p.is_file() and p.suffix not in (".py", ".pyc")}
    assert files - packed == set()


def numbers(version: str) -> list[int]:
    """3.9 comes before 3.11, which as words it does not."""
    return [int(number) for number in version.split(".")]


def test_conda_route_installs_the_same_resolve():
    env = yaml.safe_load((ROOT / "environment.yml").read_text(encoding="utf-8"))
    python = next(d for d in env["dependencies"] if str(d).startswith("python="))
    lowest = numbers(PROJECT["requires-python"].removeprefix(">="))
    assert numbers(python.removeprefix("python=")) >= lowest
    pip = next(d["pip"] for d in env["dependencies"] if isinstance(d, dict))
    index, requirements = pip  # everything else would drift from pyproject.toml
    assert requirements == "-r requirements.txt"
    assert index.split()[0] == "--extra-index-url" and index.split()[1].endswith("/whl/cpu")


def test_requirements_pin_torch_in_the_same_resolve():
    lines = (ROOT / "requirements.txt").read_text(encoding="utf-8").splitlines()
    lines = [line for line in lines if line and not line.startswith("#")]
    assert lines == ["torch==2.13.0", "-e .[dev]"]


@pytest.mark.skipif(not shutil.which("make"), reason="make is not installed")
def test_set_up_asks_for_the_pinned_torch_without_cuda_first(tmp_path):
    for name in ("Makefile", "pyproject.toml", "requirements.txt"):
        shutil.copy(ROOT / name, tmp_path)
    done = subprocess.run(
        ["make", "-n", "setup"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    small = done.stdout.index("/whl/cpu torch==2.13.0 ")
    assert done.stdout.index("nvidia-smi") < small < done.stdout.index("-r requirements.txt")


def test_card_packages_are_all_there():
    extras = PROJECT["optional-dependencies"]
    named = " ".join(PROJECT["dependencies"] + extras["notebooks"])
    for package in ("torch", "numpy", "librosa", "matplotlib", "ipywidgets", "jupyterlab"):
        assert package in named
    assert "nbval" in named and "pythreejs" in named


def test_nothing_wants_torchvision():
    """torchvision and torchaudio pull a CUDA build of torch of several GB."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert "torchvision" not in text and "torchaudio" not in text


def test_version_is_said_once():
    assert PROJECT["version"] == dancediff.__version__
    cite = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cite["version"] == dancediff.__version__ and len(cite["references"]) == 2
    assert f"## {dancediff.__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_assets_are_packaged():
    """Every asset is matched by the patterns of package-data, so that a wheel has it too."""
    tool = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
    package = ROOT / "src" / "dancediff"
    patterns = tool["setuptools"]["package-data"]["dancediff"]
    matched = {path for pattern in patterns for path in package.glob(pattern)}
    assets = {path for path in (package / "assets").rglob("*") if path.is_file()}
    assert len(assets) >= 5 and assets <= matched


@pytest.mark.skipif(not shutil.which("make"), reason="make is not installed")
@pytest.mark.parametrize("target", ["setup", "dance", "test", "wheel", "lint", "lab", "docs"])
def test_each_target_sets_up_first(target, tmp_path):
    for name in ("Makefile", "pyproject.toml", "requirements.txt"):
        shutil.copy(ROOT / name, tmp_path)
    done = subprocess.run(
        ["make", "-n", target], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert "-m venv" in done.stdout and "pip install" in done.stdout
    words = {
        "dance": "dancediff generate packaged",
        "test": "--nbval-cell-timeout",
        "lab": "jupyter",
    }
    assert done.stdout.find(words.get(target, "touch")) > done.stdout.find("pip install")


def test_ci_calls_the_readme_test_command():
    assert "make test" in (ROOT / ".ci/run").read_text(encoding="utf-8")
    assert ".ci/run" in (ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert "make dance" in readme and "make test" in readme
