"""A training of a second or two, to be killed or to run out of disk."""

CONFIG = """
[data]
songs = 1
seconds = 6.0
dancers_per_batch = 2
[model]
d_model = 8
num_heads = 1
num_layers = 1
ff_dim = 8
fusion_hidden = 8
footwork_hidden = 8
[train]
steps = STEPS
save_every = SAVE_EVERY
warmup = 5
"""


def tiny_config(steps: int, save_every: int) -> str:
    """The text of its config."""
    return CONFIG.replace("STEPS", str(steps)).replace("SAVE_EVERY", str(save_every))
