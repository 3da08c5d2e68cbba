"""THIRD_PARTY.md: every library that we ask for stands there, and none forbids what ours allows."""

import importlib.util
import re
import tomllib

import pytest

from places import ROOT

PAGE = (ROOT / "THIRD_PARTY.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def licences():
    spec = importlib.util.spec_from_file_location("licences", ROOT / "docs/site/licences.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def asked_for(licences) -> set[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"].values()
    lines = [*project["dependencies"], *(line for extra in extras for line in extra)]
    names = {licences.plain(re.match(r"[\w.-]+", line)[0]) for line in lines}
    return names - {"dancediff"}


def test_every_library_is_listed(licences):
    table = PAGE.partition(licences.HEAD)[2]
    listed = set(re.findall(r"[a-z0-9-]+", table))
    assert asked_for(licences) <= listed


def test_what_is_installed_may_be_used(licences):
    found = licences.all_needed()
    assert len(found) > 50
    assert {name for name, licence in found.items() if licence == licences.UNSAID} == set()
    strict = {  # nothing but the GPL, which would want ours to be under it, too
        name
        for name, licence in found.items()
        if all(re.search(r"(?<!L)GPL|General Public", part) for part in licence.split(" / "))
    }
    assert strict == set()


def test_what_lies_in_the_package_is_listed():
    """Songs, bodies and bundles come with a word about where they are from."""
    for folder in ("songs", "player", "body"):
        assert f"src/dancediff/assets/{folder}" in PAGE
