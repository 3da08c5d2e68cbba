"""Solutions of lesson 11."""

# %% 11.1
# The inner frames are compared with both neighbours at once. ">" on one side and "<=" on the other
# count a flat valley once, at its first frame.


def valleys(v):
    below = (v[:-2] > v[1:-1]) & (v[1:-1] <= v[2:])
    return 1 + below.nonzero()[:, 0]


# %% 11.2
# Each primitive loses the place of its own first frame, on the floor only: times (1, 0, 1) leaves
# heights alone. Nothing is written into root, so the clip it was cut from stays whole.


def forget(root):
    floor = root.new_tensor([1.0, 0.0, 1.0])
    return root - root[:, :1] * floor
