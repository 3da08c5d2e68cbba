"""What `check_network` asks of a network does not depend on what was drawn before, nor change it.

Which networks it refuses: tests/unit/test_own.py.
"""

import torch

from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.network_check import _Watched

SIZES = {"d_model": 16, "num_layers": 1, "num_heads": 2, "ff_dim": 32, "fusion_hidden": 32}


class Watched(TCDiffPP):
    """Keeps what it was given."""

    def forward(self, x_t, t, conditions):
        self.seen = [
            *getattr(self, "seen", ()),
            torch.cat([x_t.flatten(), conditions.music.flatten()]),
        ]
        return super().forward(x_t, t, conditions)


def test_both_networks_are_given_the_same_batch():
    model = Watched(TCDiffPPConfig(**SIZES, num_frames=20))
    before = torch.random.get_rng_state()
    for _ in range(2):
        _Watched(model).run()
    first, second = model.seen
    assert torch.equal(first, second) and first.std() > 0.5
    assert torch.equal(torch.random.get_rng_state(), before)
