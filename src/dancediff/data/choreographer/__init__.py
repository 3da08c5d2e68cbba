"""The choreographer: procedural group dances with known truth."""

from dancediff.data.choreographer.choreograph import DanceTruth, choreograph

__all__ = ["DanceTruth", "choreograph"]
