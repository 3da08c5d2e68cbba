"""Folders of the repository, for tests that read its files."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
BENCHMARKS, BOOKS, CONFIGS, DATA_PREP, DOCS, SOURCE = (
    ROOT / name
    for name in ("benchmarks", "notebooks", "configs", "data_prep", "docs", "src/dancediff")
)
