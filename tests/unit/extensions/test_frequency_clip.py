import torch

from dancediff.extensions.frequency_clip import FrequencyClip
from dancediff.extensions.preconditioning import Preconditioning, dct_matrix


def smooth(w=256, f=60, d=3):
    """Slow random motion: a few low frequencies."""
    g = torch.Generator().manual_seed(0)
    coefficients = torch.zeros(w, f, d)
    coefficients[:, :5] = (
        torch.randn(w, 5, d, generator=g) * torch.tensor([3.0, 2, 1, 0.5, 0.2])[:, None]
    )
    return dct_matrix(f).T @ coefficients + 0.3


def fitted():
    p = Preconditioning(60, 3)
    p.fit([smooth()])
    return p, FrequencyClip(p.mean, p.std)


def test_guesses_are_cut_where_no_dance_is():
    x = smooth()
    p, clip = fitted()
    C = dct_matrix(60).to(x)
    coefficients = C @ (x - p.mean)
    real = (coefficients.abs() < 4 * p.std).all((1, 2))
    assert real.float().mean() > 0.9
    torch.testing.assert_close(clip(x[real].float()), x[real].float(), atol=1e-4, rtol=0)
    coefficients[:, 7, 1] += 100 * p.std[7, 1]  # one frequency of one feature runs away
    back = C @ (clip(p.mean + C.T @ coefficients) - p.mean)
    torch.testing.assert_close(back[:, 7, 1], (4 * p.std[7, 1]).expand(len(x)).to(back))
    coefficients[:, 7, 1] = back[:, 7, 1]
    torch.testing.assert_close(back[real], coefficients[real], atol=1e-4, rtol=0)


def test_a_shorter_guess_is_cut_at_its_own_frequencies():
    p, clip = fitted()
    rest = p.mean.expand(30, 3)
    assert torch.allclose(clip(rest), rest, atol=1e-5)
    assert clip(rest + 1e3).abs().max() < 100
