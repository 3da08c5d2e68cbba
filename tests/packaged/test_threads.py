"""A number of threads set by hand does not stop a dance."""

import subprocess
import sys


def test_a_number_of_threads_set_by_hand_does_no_harm():
    """A batch of dense systems, as there was before, waited for ever after `set_num_threads`."""
    code = (
        "import torch; from dancediff import hub; torch.set_num_threads(2)\n"
        "model, song = hub.load('tcdiffpp'), hub.packaged_song().slice(0, 3)\n"
        "model.generate(song, dancers=2, seconds=2, steps=8, start=[(-1, 0), (1, 0)])"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=110)
