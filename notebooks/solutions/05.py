"""Solutions of lesson 05."""

# %% 05.1
# vel compares frames, dist compares dancers: what is the same for all goes out of both. contact
# does not know the truth; nobody slides, so it is zero. Only a loss of places notices.
notices = {"simple": True, "vel": False, "fk": True, "contact": False, "dist": False}


# %% 05.2
# An offset is wrong by the difference of the two dancers' errors, so a shift of the whole group
# costs nothing. Each pair counts once, and nobody with themselves.
import torch


def distance_loss(p_hat, p):
    e = p_hat - p
    i, j = torch.triu_indices(len(e), len(e), 1)
    return (e[i] - e[j]).square().mean()


# %% 05.3
# A difference of two frames of one dancer forgets where that dancer stands. So each may be put
# anywhere, as long as the steps stay; the mean over pairs of dancers (exercise 05.2) would notice.
def fool(p):
    aside = p.new_tensor([[10.0 * k, 0, 0] for k in range(len(p))])  # metres to the right
    return p + aside[:, None]
