"""From noise to a dance, whatever the network: schedule, samplers, guidance, pinning.

A network enters as a function ``denoise(x_t, t) -> x0_hat``; read `schedule`, `ddpm`, `ddim`,
`dpm_solver`, `samplers`, `guidance`, `pinning` in this order. Only the last two know of songs and
dancers: `conditions`, what a network is told besides x_t, and `long_sampling`, segment by segment.
"""

from dancediff.diffusion.ddim import ddim_step, ddim_times
from dancediff.diffusion.ddpm import ddpm_step
from dancediff.diffusion.dpm_solver import dpm_step
from dancediff.diffusion.guidance import guided, off_at_the_end, ramp_up
from dancediff.diffusion.pinning import Pinning
from dancediff.diffusion.samplers import sample
from dancediff.diffusion.schedule import abar_at, cosine_abar, gaussian, q_sample

__all__ = [
    "Pinning",
    "abar_at",
    "cosine_abar",
    "ddim_step",
    "ddim_times",
    "ddpm_step",
    "dpm_step",
    "gaussian",
    "guided",
    "off_at_the_end",
    "q_sample",
    "ramp_up",
    "sample",
]
