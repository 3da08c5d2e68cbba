"""The rate at which music is analysed, so that a whole number of samples is one frame of dance."""

from dancediff.axes import FPS

HOP = 512
SAMPLE_RATE = FPS * HOP  # 15,360 Hz makes a hop of 512 samples exactly one frame of 30 fps
