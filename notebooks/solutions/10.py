"""Solutions of lesson 10."""

# %% 10.1
# Every segment begins with frames that are danced already. They are kept from the segment that
# came first, so that nothing that was handed out changes; the first segment has no such frames.
import torch


def join(segments, overlap):
    later = [segment[:, overlap:] for segment in segments[1:]]
    return torch.cat([segments[0], *later], dim=1)
