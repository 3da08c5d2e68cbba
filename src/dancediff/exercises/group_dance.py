"""Exercises of lessons 05 to 10: the parts of TCDiff++."""

from itertools import permutations

import torch

from dancediff.diffusion.precondition import Preconditioning, dct_matrix
from dancediff.exercises.exercise import Exercise
from dancediff.motion.representation import TCDIFFPP
from dancediff.nn.ssm import selective_scan
from dancediff.tcdiffpp.footwork_adaptor import ground_velocity
from dancediff.tcdiffpp.losses import l_dist
from dancediff.tcdiffpp.order import in_order

FPS = 30


def _unlike(got, shape) -> str:
    """What is wrong with an answer that should be finite numbers of a shape, or ""."""
    if not isinstance(got, torch.Tensor):
        return f"type {type(got).__name__}, expected a tensor"
    if got.shape != shape:
        return f"shape {tuple(got.shape)}, expected {tuple(shape)}"
    return "" if got.isfinite().all() else "some of your numbers are not finite"


def _distance_loss(p_hat, p):
    return l_dist(p_hat[None], p[None])


def _distance_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    cases = [torch.randn(2, n, 5, 3, generator=draw).unbind() for n in (2, 3, 4)]
    p = cases[-1][1]
    return [*cases, (p + 1.0, p)]  # all stand aside: the offsets are right


def _strangers(p):
    return p + torch.tensor([10.0, 0, 0]) * torch.arange(len(p))[:, None, None]


def _walks(sizes=((2, 40), (3, 30), (5, 20))) -> list[tuple]:
    """Roots that wander over a stage, one metre up (n, f, 3)."""
    draw = torch.Generator().manual_seed(0)
    walks = []
    for n, f in sizes:
        root = 0.02 * torch.randn(n, f, 3, generator=draw).cumsum(1)
        places = torch.stack([torch.linspace(-1.5, 1.5, n), torch.ones(n), torch.zeros(n)], -1)
        walks.append((root * torch.tensor([1.0, 0.1, 1.0]) + places[:, None],))
    return walks


def _fools_released_loss(got, p) -> str:
    if wrong := _unlike(got, p.shape):
        return wrong
    noticed = l_dist(got[None], p[None], dist_axis="time").item()
    if noticed > 1e-6:
        return f"the released loss is {noticed:.2g}, expected less than 0.000001"
    i, j = torch.triu_indices(len(p), len(p), 1)
    apart, true = ((x[i] - x[j]).norm(dim=-1) for x in (got, p))
    least = (apart - true).abs().min().item()
    return "" if least >= 0.5 else f"a distance is wrong by {least:.2f} m only, expected 0.5 m"


def _guide(denoiser, x_t, w):
    without = denoiser(x_t, music=False)
    return without + w * (denoiser(x_t, music=True) - without)


def _guide_cases() -> list[tuple]:
    x_t = torch.randn(2, 3, 4, generator=torch.Generator().manual_seed(0))
    return [(_hears, x_t, w) for w in (0.0, 1.0, 2.0, 0.5)]


def _hears(x_t, music):
    return 0.5 * x_t + 1 if music else 0.3 * x_t - 2


def _within(x, mean, spread, C):
    known = Preconditioning(*x.shape)
    known.mean.copy_(mean)
    known.spread.copy_(spread)
    return known.within(x)


def _wild_guesses() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    cases = []
    for f, d, size in ((12, 3, 1.0), (20, 2, 8.0), (16, 1, 0.01)):
        mean = 0.8 * torch.randn(d, generator=draw)
        spread = torch.linspace(0.5, 0.01, f)[:, None] * torch.linspace(1, 2, d)
        cases.append((mean + size * torch.randn(f, d, generator=draw), mean, spread, dct_matrix(f)))
    return cases


def _bent(path, y):
    return path + torch.linspace(0, 1, len(path)) * (y - path[-1])


def _paths() -> list[tuple]:
    second = torch.arange(60) / 30
    return [(0.4 * (5 * second).sin() - 0.3, 1.2), (0.3 * (7 * second[:31]).cos(), -0.9)]


def _is_bent(got, path, y) -> str:
    if wrong := _unlike(got, path.shape):
        return wrong
    if abs(got[-1] - y) > 1e-3:
        return f"ends at {got[-1]:.3f} m, expected {y:.3f} m"
    if abs(got[0] - path[0]) > 1e-3:
        return f"starts at {got[0]:.3f} m, expected {path[0]:.3f} m, as before"
    share = abs(y - path[-1]).item() / (len(path) - 1)
    worst = (got - path).diff().abs().max().item()
    if worst > 2 * share + 1e-5:
        return f"a step changes by {worst / share:.1f} even shares, expected 2 at most"
    return ""


def _nameless(h):
    return h + h.mean(1, keepdim=True)


def _crowds() -> list[tuple]:
    """Three groups each: one, the same in another order, the same with one dancer replaced."""
    draw = torch.Generator().manual_seed(0)
    cases = []
    for order in ([2, 0, 1], [1, 3, 0, 2]):
        h, new = (torch.randn(n, 5, 4, generator=draw) for n in (len(order), 1))
        cases.append((torch.stack([h, h[order], torch.cat([new, h[1:]])]),))
    return cases


def _hears_without_names(got, h) -> str:
    if wrong := _unlike(got, h.shape):
        return wrong
    order = [(h[0] == dancer).all(-1).all(-1).nonzero().item() for dancer in h[1]]
    if not torch.allclose(got[1], got[0][order], atol=1e-4):
        return "the same dancers in another order get other tokens"
    heard = (got[2, 1:] - got[0, 1:]).abs().amax((1, 2))
    if (heard < 1e-4).any():
        return f"dancer {1 + int(heard.argmin())} does not hear that dancer 0 was replaced"
    return ""


def _ranks(root):
    return root[:, 0, 0].argsort(stable=True).argsort()


def _ranks_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    root = torch.randn(4, 20, 3, generator=draw)
    root[:, 0, 0] = torch.tensor([0.5, 1.5, -1.5, -0.5])  # its order is not its own inverse
    root[:, -1, 0] = torch.tensor([-1.5, 0.5, -0.5, 1.5])
    return [(root,), (root[:3],)]


def _mark(tokens, table):
    return tokens + table.repeat(len(tokens) // len(table), 1)


def _token_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    sizes = ((4, 3, 2), (3, 2, 5), (6, 5, 1), (7, 1, 3))  # frames, dancers, width
    return [
        (torch.randn(f * n, d, generator=draw), torch.randn(n, d, generator=draw))
        for f, n, d in sizes
    ]


def _kernel(A, B, C, delta, length):
    k = torch.arange(length)[:, None]
    return (C * torch.exp(delta * A) ** k * delta * B).sum(-1)


def _kernel_cases() -> list[tuple]:
    A, B, C = torch.tensor([[-0.5, -2.0, -8.0], [1.0, 0.5, -2.0], [0.7, 1.0, 0.3]])
    return [(A, B, C, 0.1, 12), (A[:1], B[:1], C[:1], 0.5, 5)]


def _forget_at(f, k):
    delta = torch.full((f,), 1e-4)
    delta[k] = 10.0
    return delta


def _forgets_there_only(got, f, k) -> str:
    if wrong := _unlike(got, (f,)):
        return wrong
    if (got < 0).any():
        return "a frame cannot last less than 0"
    fade = torch.exp(-got.double())
    before, there, behind = fade[1:k].prod(), fade[k], fade[k + 1 :].prod()
    for share, when in ((before, f"before frame {k}"), (behind, f"behind frame {k}")):
        if share < 0.9:
            return f"only {share:.0%} is left of what it knew {when}, expected 90 % or more"
    return "" if there < 1e-3 else f"{there:.1%} gets past frame {k}, expected less than 0.1 %"


def _each_remembers(tokens, n, memory):
    streams = tokens.reshape(-1, n, tokens.shape[-1]).transpose(0, 1)
    return memory(streams).transpose(0, 1).reshape(tokens.shape)


def _fading_memory(u):
    """Half of the past is left in the next frame (b, f, d)."""
    d, one = u.shape[-1], torch.ones(*u.shape[:2], 1)
    delta = torch.full_like(u, 0.6931)
    return selective_scan(u, delta, -torch.ones(d, 1), one, one, torch.zeros(d))


def _stream_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    sizes = ((5, 3, 2), (4, 2, 1), (3, 5, 3))  # frames, dancers, width
    return [(torch.randn(f * n, d, generator=draw), n, _fading_memory) for f, n, d in sizes]


def _swap_twice(S1, S2):
    return S1[S2]


def _swap_pairs() -> list[tuple]:
    pairs = [([1, 2, 0], [1, 0, 2]), ([0, 2, 1], [2, 0, 1]), ([3, 0, 2, 1, 4], [1, 4, 0, 3, 2])]
    return [(torch.tensor(S1), torch.tensor(S2)) for S1, S2 in pairs]


def _out_of_order() -> list[tuple]:
    cases = [
        ([-1.0, 0.2, 1.1], [2, 1, 0]),
        ([0.3, 0.0, -0.2, 0.1], [1, 3, 0, 2]),
        ([-0.8, 0.1, 0.9], [0, 1, 2]),  # all is well
        ([0.9, -1.4, 0.1], [1, 2, 0]),  # here, too
        ([0.0, 0.1], [0, 1]),
    ]
    return [(torch.tensor(x), torch.tensor(S), 0.45) for x, S in cases]


def _stands_in_order(got, x, S, gap) -> str:
    if wrong := _unlike(got, x.shape):
        return wrong
    room = got[S].diff().min().item()
    if room < gap - 1e-3:
        return f"from left to right {S.tolist()} there are {room:.2f} m to the next, expected {gap}"
    if abs(got.mean() - x.mean()) > 1e-3:
        return f"the group's middle goes from {x.mean():.2f} to {got.mean():.2f} m"
    if x[S].diff().min() >= gap and (got - x).abs().max() > 1e-3:
        return "these stand in order with room, and are moved nevertheless"
    return ""


def _floor_velocity(root):
    x = root.new_zeros(*root.shape[:-1], TCDIFFPP.dim)
    x[..., TCDIFFPP.root] = root
    return ground_velocity(x)


def _join(segments, overlap):
    return torch.cat([segments[0], *(s[:, overlap:] for s in segments[1:])], dim=1)


def _segments() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    sizes = ((3, 2, 10, 4, 5), (2, 1, 6, 3, 2), (1, 2, 8, 3, 4))  # segments, n, f, d, overlap
    return [(torch.randn(*shape, generator=draw), overlap) for *shape, overlap in sizes]


def _backwards(first):
    return first.flip(1)[:, :FPS]


def _before_seams() -> list[tuple]:
    """Dancers who walk at 1.0 to 1.5 m/s when the seam comes (n, f, 3)."""
    second = torch.arange(45)[:, None] / FPS
    ways = torch.tensor([[1.2, 0.0, 0.3], [-1.0, 0.0, 0.2], [0.0, 0.0, 1.5]])
    starts = torch.tensor([[-1.0, 0.9, 0.0], [1.0, 0.9, 0.0], [0.0, 0.9, -1.0]])
    root = starts[:, None] + second * ways[:, None]
    return [(root,), (root[:2, :36],)]


def _hides_a_seam(got, first) -> str:
    if wrong := _unlike(got, (len(first), FPS, 3)):
        return wrong
    jump = (got[:, 0] - first[:, -1]).norm(dim=-1).max().item()
    if jump > 0.01:
        return f"somebody jumps {100 * jump:.1f} cm across the seam, expected 1 cm at most"
    steps = got.diff(dim=1)
    if (farthest := steps.norm(dim=-1).max().item()) > 0.1:
        return f"a later step is {100 * farthest:.0f} cm long, expected 10 cm at most"
    before = first[:, -1] - first[:, -2]
    change = FPS * (steps[:, 0] - before).norm(dim=-1).max().item()
    return "" if change >= 1.5 else f"the velocity changes by {change:.1f} m/s only, expected 1.5"


def _shortest(start, places):
    way = torch.cdist(start, places)
    dancers = range(len(start))
    return torch.tensor(
        min(permutations(dancers), key=lambda goes: way[dancers, goes].sum().item())
    )


def _formations() -> list[tuple]:
    draw = torch.Generator().manual_seed(3)
    row = torch.stack([torch.linspace(-2, 2, 5), torch.zeros(5)], -1)
    turned = row[[3, 0, 4, 1, 2]] + torch.tensor([0.2, 1.0])
    return [
        (row, turned),
        *((2 * torch.randn(2, n, 2, generator=draw)).unbind() for n in (3, 4, 5, 5)),
    ]


EXERCISES = {
    "05.1": Exercise(
        "keep your distance",
        _distance_loss,
        "the error of an offset is the difference of two dancers' errors; take each pair of "
        "different dancers once, square, and take the mean over pairs, frames and x, y, z",
        _distance_cases,
    ),
    "05.2": Exercise(
        "who notices?",
        {"simple": True, "vel": False, "fk": True, "contact": False, "dist": False},
        "a shift that is the same for all, in every frame, goes out of every difference: between "
        "frames, between dancers",
    ),
    "05.3": Exercise(
        "fool the released loss",
        _strangers,
        "differences of neighbouring frames forget a constant: give each dancer another one",
        _walks,
        _fools_released_loss,
    ),
    "06.1": Exercise(
        "listen harder",
        _guide,
        "start from the guess without music and go w times the way to the one with it: w = 0 is "
        "silence, w = 1 plain",
        _guide_cases,
    ),
    "06.2": Exercise(
        "cut where no dance is",
        _within,
        "take the mean away, go to frequencies with C, cut each at four of its spreads, go back "
        "with C.T, add the mean",
        _wild_guesses,
    ),
    "06.3": Exercise(
        "bend it yourself",
        _bent,
        "add a share of what is missing at the end, y - path[-1], to every frame: 0 at the first, "
        "1 at the last, and nowhere in haste",
        _paths,
        _is_bent,
    ),
    "07.1": Exercise(
        "what is my rank?",
        _ranks,
        "the order says who stands k-th; a rank says which k somebody has: the inverse. Look at x, "
        "at the first frame only",
        _ranks_cases,
    ),
    "07.2": Exercise(
        "hear all, know nobody's name",
        _nameless,
        "a sum or a mean over the dancers does not know their order; the dancers are axis 1",
        _crowds,
        _hears_without_names,
    ),
    "07.3": Exercise(
        "who can part them?",
        {"nothing": False, "FP": True, "DPE": True, "DPE, FP": True, "all": True},
        "whatever treats the first in the row otherwise than the second can part them; the weights "
        "of FP are other ones for each place in the row",
    ),
    "07.4": Exercise(
        "a vector on the right token",
        _mark,
        "token k is dancer k % n, so the whole table comes again in every frame: repeat it, not "
        "its rows",
        _token_cases,
    ),
    "08.1": Exercise(
        "the memory as a kernel",
        _kernel,
        "follow one pulse: it enters as delta * B, is multiplied by exp(delta * A) once per frame "
        "(not in its own frame), and C reads the sum of all states",
        _kernel_cases,
    ),
    "08.2": Exercise(
        "forget on command",
        _forget_at,
        "in frame i everything older is multiplied by exp(-delta[i]): next to 1 where the frame is "
        "short, next to 0 where it is long",
        lambda: [(90, 30), (40, 5)],
        _forgets_there_only,
    ),
    "08.3": Exercise(
        "four times as long",
        {"Python loop": 4, "the same scan in chunks": 4, "self-attention": 16},
        "a scan does the same work for every frame; attention does some for every pair of frames",
    ),
    "08.4": Exercise(
        "whose memory?",
        _each_remembers,
        "make a batch of n streams, (n, f, d), let the memory run along the frames, and put the "
        "tokens back as they came; tokens.reshape(f, n, d) is frame by frame",
        _stream_cases,
    ),
    "09.1": Exercise(
        "swap twice",
        _swap_twice,
        "the dancer who is k-th in the end was S2[k]-th in the middle, and S1 says for each place "
        "of the middle who stands there",
        _swap_pairs,
    ),
    "09.2": Exercise(
        "put them in order",
        in_order,
        "go through S from the left and give everybody her place, or, if that is too near, one "
        "gap right of the last; in the end shift all until the middle is where it was",
        _out_of_order,
        _stands_in_order,
    ),
    "09.3": Exercise(
        "too slow to matter",
        _floor_velocity,
        "x and z are numbers 0 and 2; differences of neighbouring frames times 30 are metres a "
        "second; frame 0 has no frame before it: zeros in front",
        _walks,
    ),
    "10.1": Exercise(
        "join the segments",
        _join,
        "take the first segment whole, of every later one only what comes behind the overlap, and "
        "join along the frames",
        _segments,
    ),
    "10.2": Exercise(
        "a seam that nobody measured",
        _backwards,
        "begin where they stand, and go on in a direction in which nobody was going",
        _before_seams,
        _hides_a_seam,
    ),
    "10.3": Exercise(
        "who goes where?",
        _shortest,
        "with five dancers there are 120 ways to give out the places: measure all, keep the "
        "shortest; the result says for each dancer which place",
        _formations,
    ),
}
