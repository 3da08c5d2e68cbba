"""How large a unit of a network's input is, where the training set's range is no good choice."""

FLOOR_UNIT = 1.0  # metres; with a unit as wide as the stage, the noise of the last steps is 17 cm
MIN_SPAN = 0.2  # of a channel's range, in metres or matrix entries
