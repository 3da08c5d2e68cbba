"""Solutions of lesson 03."""


# %% 03.1
# Whatever the speed at take-off, the height changes by g / fps² less in every frame than in the one
# before. Nobody can jump with another g, so a file with a wrong frame rate gives itself away.
def true_fps(height):
    return float((9.81 / -height.diff(n=2).mean()) ** 0.5)


# %% 03.2
# Windows are 150 frames long, so two of the same take overlap when their starts are less than 150
# apart; just 150 apart they only touch. `any` counts a test window once.
def leaks(train, test):
    return sum(
        any(take == other and abs(start - begin) < 150 for other, begin in train)
        for take, start in test
    )


# %% 03.3
# A take, its song and its parts are tied, and so are takes with any tie in common. Each new take
# melts all the groups it touches into one. Whole groups go to the test set, the smallest first, so
# that no tie is ever cut.
def split(takes):
    groups = []
    for name, song, parts in takes:
        ties = {name, ("song", song), *parts}
        touched = [group for group in groups if group & ties]
        groups = [group for group in groups if not group & ties] + [ties.union(*touched)]
    test = set()
    for group in sorted(groups, key=len):
        if len(test) < len(takes) / 10:
            test |= {name for name, *_ in takes if name in group}
    return test


# %% 03.4
# With one scale a metre is the same number in every clip, and a foot that stands all the time is 1
# where one that never does is -1. With a scale for each clip both are the same. New dances may
# leave the box: to clip them would hide it, to fit on them would leak.
def rescale(train, new):
    low, high = train.amin((0, 1)), train.amax((0, 1))
    return 2 * (new - low) / (high - low) - 1


# %% 03.5
# Where the body is depends on the floor it walks over; from ankles to neck it is stretched, and the
# mean over many frames points up, since handstands are short. Frames that lie cancel while the body
# turns. The unit does not matter: only the largest of three numbers is asked for.
from dancediff.motion.skeleton import SMPL24


def up(joints):
    feet = joints[:, [SMPL24.index("lankle"), SMPL24.index("rankle")]].mean(1)
    mean = (joints[:, SMPL24.index("neck")] - feet).mean(0)
    axis = int(mean.abs().argmax())
    return ("-" if mean[axis] < 0 else "") + "xyz"[axis]
