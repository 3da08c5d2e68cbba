"""Solutions of lesson 14."""

# %% 14.1
# Of the guesses only the first is kept, then the window moves on by one frame: the oldest frame
# leaves it and the network's own takes its place. From `s` frames on it sees nothing else.
import torch


def roll(step, seed, frames):
    history, made = seed, []
    for _ in range(frames):
        new = step(history)[:, :1]
        history = torch.cat([history[:, 1:], new], dim=1)
        made.append(new)
    return torch.cat(made, dim=1)


# %% 14.2
# A distance adds up over channels, the last axis; what is left is (b, u, k), and the nearest code
# is the least along k. The faulty line added up over codes, and then chose a channel.
def nearest(z, e):
    return (z[:, :, None] - e).square().sum(-1).argmin(-1)


# %% 14.3
# p log p is 0 where p is 0, but 0 times minus infinity is nan: leave out the codes without use.
# Their number does not count: two codes in turn are a perplexity of 2 in a book of any size.
import torch


def perplexity(codes, num_codes):
    p = torch.bincount(codes.flatten(), minlength=num_codes) / codes.numel()
    p = p[p > 0]
    return torch.exp(-(p * p.log()).sum())


# %% 14.4
# Whoever dances alone, or hears all others without a name, is moved by noise only: exchanged noise,
# exchanged dances, and who comes to stand left is chance. DPE gives each index a vector of its own.
asked = {
    "each alone: dances are exchanged": True,
    "GCD: dances are exchanged": True,
    "DPE: dances are exchanged": False,
    "GCD: dancer 0 always stands left": False,
    "DPE: dancer 0 always stands left": True,
}


# %% 14.5
# All dancers choose from what was heard up to the unit before, so a column of new words is joined
# only when everybody has chosen. The running sum cuts 0 to 1 into a piece for each word, as wide as
# it is likely; the draw falls into one of them. Unlikely words are cut off, or one would come soon.
import torch


def write(logits, start, draws, top, tau):
    words = start
    for unit in range(draws.shape[1]):
        new = []
        for i in range(len(start)):
            p = torch.softmax(logits(words[: i + 1]) / tau, dim=-1)
            p, best = p.topk(top)
            sums = torch.cumsum(p / p.sum(), dim=-1)
            new.append(best[(sums <= draws[i, unit]).sum()])
        words = torch.cat([words, torch.stack(new)[:, None]], dim=1)
    return words[:, start.shape[1] :]
