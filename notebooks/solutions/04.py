"""Solutions of lesson 04."""

# %% 04.1
# The forward process is a weighted sum of dance and noise. Who knows the noise takes its share away
# and scales what is left. For large t the divisor is tiny: small errors in eps become huge.


def x0_from(x_t, eps, t, abar):
    return (x_t - (1 - abar[t]).sqrt() * eps) / abar[t].sqrt()
