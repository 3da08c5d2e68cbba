"""Long sampling with stand-in networks whose dance is known in closed form.

A dancer is two numbers a frame: lateral position and a constant "face" by which to recognise her.
Segment i carries its number in the music.
"""

import pytest
import torch

from dancediff.diffusion.long_sampling import SEAMS
from dancediff.diffusion.pinning import MODES
from dancediff.diffusion.samplers import SamplerOptions
from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions.constraint import ConstraintHook
from dancediff.extensions.initial_frames import InitialFrames
from dancediff.papers.tcdiffpp.long_group_sampling import LongGroupSampler

ABAR = cosine_abar()
FACES = torch.tensor([-0.9, -0.1, 0.3, 0.8])
PLACES = torch.linspace(-0.6, 0.6, 4)


def song(segments, f=150):
    return torch.arange(segments).float()[:, None, None].expand(segments, f, 35)


def sampler(denoise, segments, *, dancers=4, **options):
    settings = {"sampler": "ddim", "steps": 4, "eta": 1.0}
    settings |= {name: options.pop(name) for name in settings if name in options}
    usual = {"overlap": 75, "pinning": "init", "seam": "copy"}
    usual["generator"] = torch.Generator().manual_seed(0)
    return LongGroupSampler(
        shape=(dancers, 150, 2),
        bind=lambda c: lambda x_t, t: denoise(x_t, t, c.music, c.swap),
        music=song(segments),
        root_x=lambda frame: frame[:, 0],
        options=SamplerOptions(ABAR, **settings),
        **usual | options,
    )


def run(denoise, segments, **options):
    return sampler(denoise, segments, **{"pinning": "renoise"} | options).dance()


def crossing_dance(frames):
    """Four dancers who weave through each other for the whole dance, known at every frame."""
    f = torch.arange(frames) / 30
    x = 0.7 * torch.sin(0.9 * f + torch.arange(4)[:, None] * 1.7 + 4.0)
    order = x[:, 0].argsort()
    return torch.stack([x[order], FACES[:, None].expand(4, frames)], -1)


def perfect(dance, stride, error=0.0):
    """Knows the whole dance; expects, like the real network, dancers ranked at the first frame."""

    def denoise(x_t, t, M, S):
        start = int(M[0, 0, 0]) * stride
        window = dance[:, start : start + x_t.shape[2]]
        assert S.sort().values.tolist() == [list(range(len(dance)))]
        return window[window[:, 0, 0].argsort()][None] + error

    return denoise


class Obedient:
    """Goes from where the dancers are to the places that S asks for, during the new frames.

    It remembers its last segment in rank order, as the pinned frames would tell it.
    """

    def __init__(self, overlap):
        self.overlap, self.segment, self.window, self.S = overlap, -1, None, []

    def __call__(self, x_t, t, M, S):
        if int(M[0, 0, 0]) != self.segment:
            self.segment += 1
            self.S.append(S[0].tolist())
            self.window = self.plan(x_t.shape[2], S[0])
        return self.window[None]

    def plan(self, f, S):
        if self.window is None:
            known = torch.stack([PLACES, FACES], -1)[:, None]
        else:
            known = self.window[:, -self.overlap :]
            known = known[known[:, 0, 0].argsort()]
        goal = torch.empty(4)
        goal[S] = PLACES  # dancer S[k] ends on place k
        w = torch.linspace(0, 1, f - known.shape[1] + 1)[1:, None]
        new = known[:, -1:].repeat(1, len(w), 1)
        new[..., 0] += ((goal - known[:, -1, 0])[None] * w).T
        return torch.cat([known, new], 1)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("seam", sorted(SEAMS))
def test_perfect_network_gives_the_whole_dance_back(mode, seam):
    dance = crossing_dance(150 + 75 * 8)
    assert (dance[:, ::75, 0].argsort(0).diff(dim=1) != 0).any()  # ranks do change between segments
    x = run(perfect(dance, 75), 9, pinning=mode, seam=seam)
    assert x.shape == (4, 750, 2)
    torch.testing.assert_close(x, dance, atol=1e-6, rtol=0)


@pytest.mark.parametrize(("segments", "overlap"), [(1, 75), (2, 75), (4, 40), (5, 100), (3, 149)])
def test_length_and_pieces(segments, overlap):
    frames = 150 + (150 - overlap) * (segments - 1)
    dance = crossing_dance(frames)
    x = run(perfect(dance, 150 - overlap), segments, overlap=overlap)
    torch.testing.assert_close(x, dance, atol=1e-6, rtol=0)
    pieces = sampler(perfect(dance, 150 - overlap), segments, overlap=overlap, steps=1).pieces()
    sizes = [piece.shape[1] for piece in pieces]
    assert sizes == [150 - overlap] * segments + [overlap]


@pytest.mark.parametrize("mode", MODES)
def test_overlap_agrees_with_the_segment_before(mode):
    # Each segment is off by another amount, so only the copy can make the shared frames agree.
    dance = crossing_dance(150 + 75 * 3)
    drawn = {}

    def sloppy(x_t, t, M, S):
        i = int(M[0, 0, 0])
        drawn[i] = perfect(dance, 75, error=0.01 * i)(x_t, t, M, S)
        return drawn[i]

    x = run(sloppy, 4, pinning=mode, steps=3)
    for i in range(3):
        shared = x[:, 75 * (i + 1) : 75 * (i + 2)]
        by_face = lambda a: a[a[:, 0, 1].argsort()]  # noqa: E731
        gap = by_face(drawn[i][0, :, 75:]) - by_face(shared)
        assert float(gap.abs().max()) < 1e-5


@pytest.mark.parametrize("mode", MODES)
def test_a_longer_dance_starts_like_the_shorter_one(mode):
    network = lambda x_t, t, M, S: x_t * 0.5  # noqa: E731
    short, long = (
        run(network, k, pinning=mode, generator=torch.Generator().manual_seed(6)) for k in (3, 4)
    )
    assert torch.equal(long[:, :300], short)


def test_seams_of_an_imperfect_network():
    dance = crossing_dance(150 + 75 * 3)

    def sloppy(x_t, t, M, S):
        return perfect(dance, 75, error=0.02 * int(M[0, 0, 0]))(x_t, t, M, S)

    def jump(**options):
        x = run(sloppy, 4, **options)
        return float((x.diff(dim=1) - dance.diff(dim=1))[..., 0].abs().max())

    std = 0.5 / (1 + torch.arange(150.0)[:, None].repeat(1, 2)) ** 2
    assert jump() == pytest.approx(0.02, abs=1e-4)
    assert jump(hooks=[ConstraintHook(std, [InitialFrames()])]) < 0.004
    assert jump(seam="fade") < 0.001


@pytest.mark.parametrize("overlap", [75, 100, 40])
@pytest.mark.parametrize("swap_in", [0, 4])
def test_swap_in_the_middle_and_nobody_snaps_back(overlap, swap_in):
    stride = 150 - overlap
    segments = -(-(720 - 150) // stride) + 1
    swapped, stay = [2, 0, 1, 3], [0, 1, 2, 3]
    targets = [stay] * swap_in + [swapped] * (segments - swap_in)
    network = Obedient(overlap)
    x = run(network, segments, overlap=overlap, targets=targets)[:, :720]
    assert x.shape == (4, 720, 2)
    assert torch.equal(x[..., 1], FACES[:, None].expand(4, 720))  # nobody is renamed
    assert float(x[..., 0].diff(dim=1).abs().max()) < 1.3 / stride  # nobody jumps
    crossing = slice(swap_in * stride + (overlap if swap_in else 1), swap_in * stride + 150)
    orders = x[..., 0].argsort(0).T
    assert (orders[: crossing.start] == torch.tensor(stay)).all()
    assert (orders[crossing.stop - 1 :] == torch.tensor(swapped)).all()


def test_s_speaks_of_ranks_at_the_segments_own_first_frame():
    network = Obedient(75)
    run(network, 5, targets=[[0, 1, 2, 3], [1, 0, 2, 3], None, [1, 0, 3, 2], None])
    # Segment 2 starts before the swap of segment 1, so it has the swapped order as target.
    assert network.S == [[0, 1, 2, 3], [1, 0, 2, 3], [1, 0, 2, 3], [0, 1, 3, 2], [0, 1, 3, 2]]


def test_without_a_target_all_dancers_keep_their_order():
    network = Obedient(75)
    x = run(network, 4)
    assert network.S == [[0, 1, 2, 3]] * 4
    assert float(x[..., 0].diff(dim=1).abs().max()) < 1e-6


def test_without_a_target_a_crossing_that_is_under_way_is_finished():
    # The network crosses two dancers though nobody asked; the next segment must not undo it.
    dance = torch.stack([PLACES[:, None].repeat(1, 225), FACES[:, None].expand(4, 225)], -1)
    w = torch.linspace(0, 1, 60)
    dance[0, 80:140, 0] = PLACES[0] + (PLACES[1] - PLACES[0]) * w
    dance[1, 80:140, 0] = PLACES[1] + (PLACES[0] - PLACES[1]) * w
    dance[:2, 140:, 0] = PLACES[:2].flip(0)[:, None]
    seen = []

    def denoise(x_t, t, M, S):
        seen.append(S[0].tolist())
        return perfect(dance, 75)(x_t, t, M, S)

    run(denoise, 2, steps=1)
    assert seen == [[0, 1, 2, 3], [1, 0, 2, 3]]


def test_dancers_are_numbered_from_the_left_at_the_first_frame():
    def unsorted(x_t, t, M, S):  # a network that does not respect the ranks it was given
        rows = torch.stack([PLACES, FACES], -1)[[2, 0, 3, 1]]
        return rows[None, :, None].expand_as(x_t)

    x = run(unsorted, 1)
    assert torch.equal(x[:, 0, 0], PLACES)
    assert torch.equal(x[:, 0, 1], FACES)


def test_pinned_frames_reach_the_network_in_rank_order():
    dance = crossing_dance(225)
    seen = {}

    def denoise(x_t, t, M, S):
        seen[int(M[0, 0, 0]), t] = x_t.clone()
        return perfect(dance, 75)(x_t, t, M, S)

    run(denoise, 2, pinning="renoise", steps=1000, eta=0.0)
    window = dance[:, 75:150]
    window = window[window[:, 0, 0].argsort()]
    assert float((seen[1, 0][0, :, :75] - window).std()) < 0.01  # at t = 0 almost clean
    assert float((seen[1, 999][0, :, :75] - window).std()) > 0.9


def test_init_reuses_the_noise_of_the_segment_before():
    dance, seen, orders = crossing_dance(300), {}, {}

    def denoise(x_t, t, M, S):
        i = int(M[0, 0, 0])
        seen.setdefault(i, x_t[0].clone())
        out = perfect(dance, 75)(x_t, t, M, S)
        orders[i] = out[0, :, 0, 1].tolist()  # which face is on which row of the network
        return out if i else out[:, [1, 0, 2, 3]]  # segment 0 comes out unsorted

    run(denoise, 3, pinning="init")
    orders[0] = [orders[0][i] for i in (1, 0, 2, 3)]
    for i in (1, 2):
        rows = [orders[i - 1].index(face) for face in orders[i]]
        assert rows != [0, 1, 2, 3]
        torch.testing.assert_close(seen[i][:, :75], seen[i - 1][rows, 75:], atol=1e-4, rtol=0)


def test_every_segment_hears_its_own_music_and_progress_counts_all_steps():
    dance, heard, ticks = crossing_dance(300), [], []

    def denoise(x_t, t, M, S):
        heard.append(int(M[0, 0, 0]))
        assert M.shape == (1, 150, 35) and x_t.shape == (1, 4, 150, 2)
        return perfect(dance, 75)(x_t, t, M, S)

    run(denoise, 3, steps=2, callback=lambda done, total, x0_hat: ticks.append((done, total)))
    assert heard == [0, 0, 1, 1, 2, 2]
    assert ticks == [(i + 1, 6) for i in range(6)]


def test_one_dancer():
    network = lambda x_t, t, M, S: torch.zeros_like(x_t)  # noqa: E731
    assert run(network, 3, dancers=1).shape == (1, 300, 2)


@pytest.mark.parametrize("mode", MODES)
def test_seed_fixes_the_bits(mode):
    network = lambda x_t, t, M, S: x_t * 0.5  # noqa: E731
    runs = [
        run(network, 3, pinning=mode, generator=torch.Generator().manual_seed(s)) for s in (3, 3, 4)
    ]
    assert torch.equal(runs[0], runs[1])
    assert not torch.allclose(runs[0], runs[2], atol=1e-3)


def test_errors():
    network = lambda x_t, t, M, S: x_t  # noqa: E731
    for options, match in [
        ({"overlap": 0}, "overlap=0"),
        ({"overlap": 150}, "overlap=150"),
        ({"seam": "glue"}, "seam='glue'"),
        ({"pinning": "glue"}, "pinning='glue'"),
        ({"targets": [[0, 1, 2, 3]]}, "targets has 1 entries for 2 segments"),
        ({"targets": [None, [0, 1, 1, 3]]}, r"targets\[1\]=\[0, 1, 1, 3\]"),
        ({"sampler": "euler"}, "sampler='euler'"),
    ]:
        with pytest.raises(ValueError, match=match):
            run(network, 2, **options)
    with pytest.raises(ValueError, match="music has no segment"):
        run(network, 0)


class Watching:
    """A hook that changes nothing and keeps the segments that it was made for."""

    def __init__(self):
        self.segments = []

    def for_segment(self, segment):
        self.segments.append(segment)


def test_resampled_frames_are_not_kept_from_the_segment_before():
    hook = Watching()
    sampler(lambda x_t, t, M, S: x_t, 2, resampled=30, hooks=[hook]).dance()
    kept = hook.segments[1].mask.all(-1).all(0)
    assert kept.tolist() == [True] * 45 + [False] * 105
    assert hook.segments[1].context.shape[1] == 45


def test_what_is_fixed_belongs_to_a_dancer_in_whichever_row():
    hook, mask = Watching(), torch.zeros(4, 225, 2, dtype=torch.bool)
    mask[0, 100:200] = True
    order = torch.tensor([2, 0, 1, 3])  # dancer 0 stands second
    static = torch.stack([PLACES, FACES], -1)[:, None].expand(4, 150, 2)[None]
    sampler(lambda x_t, t, M, S: static, 2, mask=mask, initial_order=order, hooks=[hook]).dance()
    first, second = (segment.mask.any(-1) for segment in hook.segments)
    assert first[1].nonzero().flatten().tolist() == list(range(100, 150))
    assert not first[[0, 2, 3]].any()
    # behind the context, which is fixed for everybody
    assert second[1, 75:125].all() and not second[[0, 2, 3], 75:].any()
