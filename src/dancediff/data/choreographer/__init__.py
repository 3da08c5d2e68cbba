"""The choreographer: procedural group dances in ten genres, with known truth."""

from dancediff.data.choreographer.choreograph import DanceTruth, choreograph
from dancediff.data.choreographer.genres import GENRES

__all__ = ["GENRES", "DanceTruth", "choreograph"]
