"""Solutions of lesson 13."""

# %% 13.1
# PFC weighs how hard the root accelerates with how far the feet travel. A statue does neither, so
# its PFC is 0, the best there is. It has no moment of rest between two movements either: BAS is 0.
from dataclasses import replace


def cheat(dance):
    pose = dance.pose[:, :1].expand_as(dance.pose).clone()
    return replace(dance, pose=pose, root=dance.root[:, :1].expand_as(dance.root).clone())
