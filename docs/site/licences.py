"""List the licences of all libraries that an installation brings: python docs/site/licences.py

Rewrites the table at the end of THIRD_PARTY.md. Walks from the project's own dependencies, extras
included, through what they need, and reads what each says about itself. Libraries that are not
installed here (of another system, or the extra `docs` before `make docs`) are left out.
"""

import re
import sys
from collections import defaultdict
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from dancediff.atomic import write_text

PAGE = Path(__file__).parents[2] / "THIRD_PARTY.md"
HEAD = "## Libraries\n"
OWN, UNSAID = "dancediff", "not said"
EMPTY = {"cuda-toolkit"}  # nothing but a list of what it needs, so it names no licence
WORDS = """\
Installed by pip, not part of this repository: {count} with all extras, what they need included.
`python docs/site/licences.py` writes this table from what they say of themselves.
Two wheels bring more than that: soundfile has libsndfile (LGPL-2.1-or-later), av FFmpeg with x264
(GPL-2.0-or-later); av is needed for .mp4 alone. PyTorch's build for NVIDIA's GPUs, if it is that
one, brings NVIDIA's libraries, which are proprietary.
"""
SHORT = {  # words of older packages -> SPDX
    "mit": "MIT", "mit license": "MIT", "the mit license": "MIT", "expat": "MIT",
    "isc license (iscl)": "ISC", "isc license": "ISC", "isc": "ISC",
    "bsd": "BSD-3-Clause", "bsd license": "BSD-3-Clause", "bsd 3-clause": "BSD-3-Clause",
    "bsd-3-clause license": "BSD-3-Clause", "new bsd": "BSD-3-Clause", "bsd 3": "BSD-3-Clause",
    "bsd 3-clause license": "BSD-3-Clause", "3-clause bsd license": "BSD-3-Clause",
    "modified bsd license": "BSD-3-Clause", "revised bsd license": "BSD-3-Clause",
    "apache software license": "Apache-2.0", "apache license 2.0": "Apache-2.0",
    "apache 2.0": "Apache-2.0", "apache 2.0 license": "Apache-2.0", "apache": "Apache-2.0",
    "apache-2.0 license": "Apache-2.0", "apache license, version 2.0": "Apache-2.0",
    "mozilla public license 2.0 (mpl 2.0)": "MPL-2.0", "mpl 2.0": "MPL-2.0",
    "python software foundation license": "PSF-2.0", "psf": "PSF-2.0",
    "the unlicense (unlicense)": "Unlicense", "boost software license 1.0 (bsl-1.0)": "BSL-1.0",
    "historical permission notice and disclaimer (hpnd)": "HPND",
}  # fmt: skip


def licence_of(name: str) -> str:
    """What a library says its licence is, as SPDX writes it where that is known."""
    meta = distribution(name).metadata
    classes = [c.split(" :: ")[-1] for c in meta.get_all("Classifier") or [] if "License ::" in c]
    words = meta.get("License-Expression") or " / ".join(classes) or meta.get("License") or ""
    words = words.strip().splitlines()[0] if words.strip() else UNSAID
    parts = [SHORT.get(part.lower(), part) for part in words.split(" / ")]
    said = [part for part in parts if part not in ("OSI Approved", "DFSG approved")]
    return " / ".join(dict.fromkeys(said)) or SHORT.get((meta.get("License") or "").lower(), UNSAID)


def needed(name: str, extras: set[str]) -> set[str]:
    """Names of what a library needs for these of its extras, as far as it is installed."""
    from packaging.requirements import Requirement

    found = set()
    for text in distribution(name).requires or []:
        one = Requirement(text)
        wanted = one.marker is None or any(
            one.marker.evaluate({"extra": extra}) for extra in extras | {""}
        )
        if wanted:
            found.add((plain(one.name), frozenset(one.extras)))
    return found


def plain(name: str) -> str:
    """A name as package indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def all_needed() -> dict[str, str]:
    """Every library of an installation with all extras, and its licence."""
    extras = set(distribution(OWN).metadata.get_all("Provides-Extra") or [])
    todo, seen, found = [(OWN, frozenset(extras))], set(), {}
    while todo:
        one = todo.pop()
        if one in seen:
            continue
        seen.add(one)
        try:
            if one[0] not in {OWN, *EMPTY}:
                found[one[0]] = licence_of(one[0])
            todo += needed(one[0], set(one[1]))
        except PackageNotFoundError:
            continue
    return found


def table(found: dict[str, str]) -> str:
    """A row a licence: the libraries in it."""
    groups = defaultdict(list)
    for name, licence in sorted(found.items()):
        groups[licence].append(name)
    rows = sorted(groups.items(), key=lambda item: (-len(item[1]), item[0]))
    lines = ["| licence | libraries |", "| --- | --- |"]
    return "\n".join(lines + [f"| {licence} | {', '.join(names)} |" for licence, names in rows])


def main() -> int:
    """Write the table anew."""
    found = all_needed()
    text, _, _ = PAGE.read_text(encoding="utf-8").partition(HEAD)
    words = WORDS.format(count=len(found))
    page = f"{text.rstrip()}\n\n{HEAD}\n{words}\n{table(found)}\n"
    write_text(PAGE, page)
    print(f"{len(found)} libraries")
    return 0


if __name__ == "__main__":
    sys.exit(main())
