"""Right answers to the exercises, each written otherwise than its solution.

A checker must take them all. Predictions have one right answer and none here.
"""

import itertools
import math
from dataclasses import replace

import numpy as np
import torch
import torch.nn.functional as F
from scipy import stats
from scipy.spatial.transform import Rotation
from torch import cat, nn, stack, tensor, zeros

from dancediff.diffusion.ddim import ddim_step
from dancediff.diffusion.samplers import SamplerOptions
from dancediff.diffusion.schedule import q_sample
from dancediff.extensions.ssd import ssd_scan
from dancediff.metrics.rhythm import closeness
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import rot6d_to_matrix, rotation_about
from dancediff.motion.skeleton import world_rotations
from dancediff.nn.conditioning import ConcatSquashLinear
from dancediff.papers.lodge.primitives import Layout, primitive_frames
from dancediff.papers.tcdiffpp.footwork_adaptor import ground_velocity
from dancediff.papers.tcdiffpp.long_group_sampling import LongGroupSampler

# 00 · Tour: music in, dance out


def song_by_clock(bpm, bars, rate):
    """For each sample the time since the last kick and since the last click."""
    beat = 60 / bpm
    seconds = np.arange(int(4 * bars * beat * rate)) / rate + 1e-9
    since = seconds % beat
    kick = 0.7 * np.cos(300 * since) * np.exp(-40 * since)
    click = np.where(since >= beat / 2, 0.2 * np.exp(-200 * (since - beat / 2)), 0)
    return torch.tensor(np.where(seconds < 4 * (bars - 1) * beat, kick + click, 0))


def song_of_noise(bpm, bars, rate):
    """Short bursts of noise, one half of a beat after the other."""
    draw = np.random.default_rng(0)
    song = []
    for k in range(8 * bars):
        length = round((k + 1) * 30 / bpm * rate) - round(k * 30 / bpm * rate)
        burst = draw.uniform(-1, 1, length) * np.exp(-np.arange(length) / (0.02 * rate))
        burst *= (0.9, 0.35)[k % 2] / np.abs(burst).max()
        song += (burst * (k < 8 * (bars - 1))).tolist()
    return song


# 01 · A dance is a tensor


def hand_by_world_rotations(pose):
    out = pose.clone()
    up = rotation_about("z", tensor(math.pi / 2)) @ rotation_about("x", tensor(0.7))
    out[16] = world_rotations(pose)[13].inverse() @ up
    out[18] = out[20] = torch.eye(3)
    return out


def hand_slightly_bent(pose):
    out = hand_by_world_rotations(pose)
    out[18] = rotation_about("y", tensor(0.3))
    return out


def six_in_a_loop(d6):
    flat = d6.reshape(-1, 2, 3)
    rows = []
    for a, b in flat:
        b1 = a / a.norm()
        b2 = b - b1.dot(b) * b1
        b2 = b2 / b2.norm()
        rows.append(stack([b1, b2, torch.linalg.cross(b1, b2)]))
    return stack(rows).reshape(*d6.shape[:-1], 3, 3)


def six_by_crosses(d6):
    b1 = F.normalize(d6[..., :3], dim=-1)
    b3 = F.normalize(torch.cross(b1, d6[..., 3:], dim=-1), dim=-1)
    return stack([b1, torch.cross(b3, b1, dim=-1), b3], -2)


def resample_frame_by_frame(x, old, new):
    """All joints of a frame at once, by scipy; the turn as the parent sees it."""
    frames, i = [], 0
    while i * old <= (x.shape[1] - 1) * new:
        k, w = divmod(i * old, new)
        frames.append(x[:, k].clone())
        if w:
            w /= new
            frames[-1][:, 4:7] = (1 - w) * x[:, k, 4:7] + w * x[:, k + 1, 4:7]
            R, S = (rot6d_to_matrix(x[:, j, 7:].reshape(-1, 6)) for j in (k, k + 1))
            turn = Rotation.from_matrix((S @ R.mT).numpy()).as_rotvec()
            R = Rotation.from_rotvec(w * turn).as_matrix() @ R.numpy()
            frames[-1][:, 7:] = tensor(R[:, :2].reshape(len(x), -1))
        i += 1
    return stack(frames, dim=1)


def resample_by_quaternions(x, old, new):
    count = (x.shape[1] - 1) * new // old + 1
    when = np.arange(count) * old / new
    k = np.minimum(np.floor(when).astype(int), x.shape[1] - 2)
    w = tensor(when - k)[None, :, None]
    contact = x[:, np.floor(when).astype(int), :4]
    a, b = (rot6d_to_matrix(x[:, j, 7:].reshape(-1, 6)).double().numpy() for j in (k, k + 1))
    q, r = (Rotation.from_matrix(R).as_quat() for R in (a, b))
    cos = (q * r).sum(-1, keepdims=True)
    r, half = r * np.where(cos < 0, -1, 1), np.arccos(np.abs(cos).clip(max=1 - 1e-12))
    share = w.expand(len(x), -1, 24).reshape(-1, 1).numpy()
    q = np.sin((1 - share) * half) * q + np.sin(share * half) * r  # as_matrix divides by its length
    d6 = Rotation.from_quat(q).as_matrix()[:, :2].reshape(len(x), count, 144)
    return cat([contact, x[:, k, 4:7].lerp(x[:, k + 1, 4:7], w.float()), tensor(d6)], dim=-1)


# 02 · What the model hears


def tones_cross():
    S = np.full((128, 2), -50.0)
    S[::2, 1] += 25
    S[1::2, 1] -= 30
    return S


def tempo_from_sorted_gaps(M):
    beats = [f for f in range(len(M)) if M[f, 34] == 1]
    gaps = sorted(b - a for a, b in itertools.pairwise(beats))
    return 1800 / gaps[len(gaps) // 2]


def stretches_by_arrays(beats, seconds):
    t = np.concatenate([[0.0], beats, [seconds]])
    where = np.diff(t) > 2.2
    return np.stack([t[:-1][where], t[1:][where]], axis=1)


def track_forwards(onset, period, tightness):
    """Each frame hands its total on to those that may follow; choices are kept whole."""
    best = [(float(o), [i]) for i, o in enumerate(onset)]
    for j in range(len(onset)):
        total, beats = best[j]
        for i in range(j + 1, len(onset)):
            if period / 2 <= i - j <= 2 * period:
                new = total - tightness * math.log((i - j) / period) ** 2 + onset[i]
                best[i] = max(best[i], (new, [*beats, i]), key=lambda one: one[0])
    return max(best, key=lambda one: one[0])[1]


def track_from_the_end(onset, period, tightness):
    """The best that can still come after a beat; then go on from the best first one."""
    o, f = tensor(onset), len(onset)
    gaps = torch.arange(f)[None] - torch.arange(f)[:, None]  # from beat to beat
    cost = tightness * (gaps.clamp(min=1) / period).log().square()
    cost = torch.where((gaps >= period / 2) & (gaps <= 2 * period), cost, torch.inf)
    total, after = o.clone(), [-1] * f
    for j in reversed(range(f)):
        more, i = (total - cost[j]).max(0)
        if more > 0:
            total[j], after[j] = o[j] + more, int(i)
    beats = [int(total.argmax())]
    while after[beats[-1]] >= 0:
        beats.append(after[beats[-1]])
    return tensor(beats)


# 03 · A data set you can trust


def leaks_by_frames(train, test):
    seen = {(take, f) for take, start in train for f in range(start, start + 150)}
    return len([1 for take, s in test if seen & {(take, f) for f in range(s, s + 150)}])


def split_by_union_find(takes):
    parent = {}

    def root(x):
        while parent.setdefault(x, x) != x:
            x = parent[x]
        return x

    for name, song, parts in takes:
        for other in (("song", song), *parts):
            parent[root(other)] = root(name)
    groups = {}
    for name, *_ in takes:
        groups.setdefault(root(name), []).append(name)
    chosen = []
    for group in sorted(groups.values(), key=len):
        if len(chosen) + len(group) <= 0.4 * len(takes):
            chosen += group
    return chosen


def up_by_votes(joints):
    spine = joints[:, 15] - joints[:, 0]  # from the pelvis to the head
    axes = spine.abs().argmax(-1)
    votes = [f"{'-' if s[k] < 0 else ''}{'xyz'[k]}" for s, k in zip(spine, axes, strict=True)]
    return max(set(votes), key=votes.count)


def up_by_products(joints):
    names = ["x", "y", "z", "-x", "-y", "-z"]
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    body = joints.numpy()
    sums = ((body[:, 12] - body[:, 10]) + (body[:, 12] - body[:, 11])).sum(0)
    return names[int((axes @ sums).argmax())]


def rescale_flat(train, new):
    flat = train.reshape(-1, train.shape[-1])
    low, high = flat.min(0).values, flat.max(0).values
    middle, half = (low + high) / 2, (high - low) / 2
    return (new - middle) / half


# 04 · Destroying a dance


def training_step_by_torch(net, W, batch, abar, weight, rate):
    x_0, t = batch["x_0"], batch["t"]
    moved = nn.Parameter(W.clone())
    M = torch.where(batch["keep"][:, None, None], batch["M"], 0.0)
    guess = net(moved, q_sample(x_0, t, abar, batch["eps"]), t, M)
    errors = F.mse_loss(guess, x_0, reduction="none").flatten(1).mean(1)
    loss = errors @ weight[t] / len(t)
    loss.backward()
    nn.utils.clip_grad_norm_([moved], 1.0)
    torch.optim.SGD([moved], lr=rate).step()
    return loss, moved


def training_step_dance_by_dance(net, W, batch, abar, weight, rate):
    W, loss = W.clone().requires_grad_(), 0.0
    for x_0, M, t, eps, keep in zip(*batch.values(), strict=True):
        x_t = math.sqrt(abar[t]) * x_0 + math.sqrt(1 - abar[t]) * eps
        guess = net(W, x_t[None], t[None], (M if keep else zeros(M.shape))[None])[0]
        loss = loss + weight[t] * ((guess - x_0) ** 2).mean() / len(batch["t"])
    slope = torch.autograd.grad(loss, W)[0]
    length = slope.square().sum().sqrt()
    return loss.item(), W.detach() - rate * (slope / length if length > 1 else slope)


# 05 · A denoiser that listens


def distance_in_a_loop(p_hat, p):
    total, pairs = 0.0, list(itertools.combinations(range(len(p)), 2))
    for i, j in pairs:
        total = total + (((p[i] - p[j]) - (p_hat[i] - p_hat[j])) ** 2).mean()
    return total / len(pairs)


def distance_by_variance(p_hat, p):
    """The mean square over pairs is twice the unbiased variance over dancers."""
    return 2 * (p_hat - p).var(dim=0).mean()


def layer_by_torch(h, memory, c, W):
    def block(k, x):
        if k == 2:
            return F.linear(F.gelu(F.linear(x, W["in"].T)), W["out"].T)
        m, maps = (x, W["self"]) if k == 0 else (memory, W["cross"])
        return F.scaled_dot_product_attention(x @ maps[0], m @ maps[1], m @ maps[2])

    for k in range(3):
        scale, shift = torch.split(F.mish(c) @ W["film"][k], len(c))
        h = torch.addcmul(h + shift, 1 + scale, block(k, F.layer_norm(h, (len(c),))))
    return h


def layer_token_by_token(h, memory, c, W):
    d = len(c)
    for k, name in enumerate(("self", "cross", None)):
        x = (h - h.mean(1, keepdim=True)) / (h.var(1, correction=0, keepdim=True) + 1e-5).sqrt()
        m, rows = (x if k == 0 else memory), []
        for token in x:
            if name is None:
                rows.append(F.gelu(token @ W["in"]) @ W["out"])
                continue
            query, keys, values = token @ W[name][0], m @ W[name][1], m @ W[name][2]
            share = torch.exp(keys @ query / d**0.5)
            rows.append(share @ values / share.sum())
        film = F.mish(c) @ W["film"][k]
        h = h + (1 + film[:d]) * torch.stack(rows) + film[d:]
    return h


def far_circle(p):
    angle = torch.arange(len(p)) * 2 * math.pi / len(p)
    return p + 100 * stack([angle.cos(), 0 * angle, angle.sin()], -1)[:, None]


def upstairs(p):
    out = p.clone()
    for k in range(len(p)):
        out[k, :, 1] += 12 * k
    return out


# 06 · The sampling lab


def clip_by_minimum(x, mean, std, C):
    waves = torch.einsum("fg,gd->fd", C, x - mean)
    waves = torch.minimum(torch.maximum(waves, -4 * std), 4 * std)
    return torch.einsum("gf,gd->fd", C, waves) + mean


def soft_landing(path, y):
    s = torch.linspace(0, 1, len(path))
    return path + (3 * s**2 - 2 * s**3) * (y - path[-1])


def cosine_landing(path, y):
    s = (1 - torch.cos(math.pi * torch.arange(len(path)) / (len(path) - 1))) / 2
    return (1 - s) * path + s * (path + y - path[-1])


def walk_by_library(denoise, x_T, times, abar, eta, noise):
    x = x_T
    for k in range(len(times) - 1):
        t, t_next = times[k], times[k + 1]
        x_0 = denoise(x, t)
        x = ddim_step(x, x_0, t, t_next, abar, eta=0.0)
        if t_next >= 0 and eta:
            eps = (x - abar[t_next].sqrt() * x_0) / (1 - abar[t_next]).sqrt()
            sigma = eta * ((1 - abar[t_next]) / (1 - abar[t]) * (1 - abar[t] / abar[t_next])).sqrt()
            kept = (1 - abar[t_next] - sigma**2).sqrt()
            x = abar[t_next].sqrt() * x_0 + kept * eps + sigma * noise[k]
    return x


def walk_down(denoise, x_T, times, abar, eta, noise):
    """Each step by a call of its own, with signal and noise as powers."""
    t, t_next = times[:2]
    guess = denoise(x_T, t)
    if t_next == -1:
        return guess
    p, q = float(abar[t]), float(abar[t_next])
    fresh = eta**2 * (1 - q) / (1 - p) * (1 - p / q)
    old = (x_T - math.sqrt(p) * guess) / math.sqrt(1 - p)
    x = math.sqrt(q) * guess + math.sqrt(1 - q - fresh) * old + math.sqrt(fresh) * noise[0]
    return walk_down(denoise, x, times[1:], abar, eta, noise[1:])


# 07 · Who stands where?


def attention(h):
    rows = h.movedim(1, 2)  # (b, f, n, d)
    weights = torch.softmax(rows @ rows.mT, dim=-1)
    return (weights @ rows).movedim(2, 1)


def hears_the_others(h):
    return h.sum(1, keepdim=True) - h


def ranks_by_counting(root):
    x = root[:, 0, 0]
    return (x[None] < x[:, None]).sum(1)


def ranks_in_a_loop(root):
    order = sorted(range(len(root)), key=lambda k: root[k, 0, 0].item())
    return [order.index(k) for k in range(len(root))]


def mark_in_a_loop(tokens, table):
    return stack([token + table[k % len(table)] for k, token in enumerate(tokens)])


def mark_in_frames(tokens, table):
    return (tokens.reshape(-1, *table.shape) + table).reshape(tokens.shape)


def prior_by_loops(x, C):
    n, f = x.shape[1:]
    groups = [group[group[:, 0].argsort()] for group in x]
    place = stack([group[:, 0] for group in groups]).mean(0)
    ways, along = [], zeros(f)
    for group in groups:
        rank_at_end = [(group[:, -1] < end).sum() for end in group[:, -1]]
        ways.append(stack([place[k] for k in rank_at_end]) - place)
        for way, path, begin in zip(ways[-1], group, place, strict=True):
            along += way * (path - begin)
    progress = along / sum(way.dot(way) for way in ways)
    waves = [
        [C @ (path - begin - step * progress) for path, begin, step in zip(*one, strict=True)]
        for one in zip(groups, [place] * len(groups), ways, strict=True)
    ]
    basis, std = zeros(f, n, n), zeros(f, n)
    for k in range(f):
        here = stack([stack([wave[k] for wave in group]) for group in waves])
        size, basis[k] = torch.linalg.eigh(here.T @ here / len(here))
        std[k] = size.clamp(min=0) ** 0.5
    return place, progress, basis, std


def prior_by_svd(x, C):
    """In numpy; the largest formation first."""
    x = np.take_along_axis(x.numpy(), np.argsort(x[:, :, :1].numpy(), axis=1), axis=1)
    place = x[:, :, 0].mean(axis=0)
    way = place[np.argsort(np.argsort(x[:, :, -1], axis=1), axis=1)] - place
    moved = (x - place[:, None]).reshape(-1, x.shape[2])
    progress = np.linalg.lstsq(way.reshape(-1, 1), moved, rcond=None)[0][0]
    left = x - place[:, None] - way[:, :, None] * progress
    basis, std, _ = np.linalg.svd((left @ C.numpy().T).transpose(2, 1, 0), full_matrices=False)
    return place, progress, basis, std / len(x) ** 0.5


# 08 · A memory for time


def kernel_step_by_step(A, B, C, delta, length):
    state, out = delta * B, []
    for _ in range(length):
        out.append((C * state).sum())
        state = torch.exp(delta * A) * state
    return stack(out)


def kernel_by_einsum(A, B, C, delta, length):
    powers = torch.exp(delta * torch.outer(torch.arange(length), A))
    return torch.einsum("ks,s,s->k", powers, B, C) * delta


def forgets_once(f, k):
    delta = zeros(f)
    delta[k] = 7.0
    return delta


def forgets_a_little_always(f, k):
    return torch.where(torch.arange(f) == k, 50.0, 0.05 / f)


def remember_one_by_one(tokens, n, memory):
    out = torch.empty_like(tokens)
    for k in range(n):
        out[k::n] = memory(tokens[None, k::n])[0]
    return out


def live_by_einsum(x, past, h, block):
    u, z = block.in_proj(x).chunk(2, -1)
    seen = cat([past, u[:, None]], 1)
    u = F.silu(block.conv(seen.mT)[..., 3])
    B, C = block.x_proj(u)[..., -2 * block.d_state :].chunk(2, -1)
    dt = block.x_proj(u)[..., : -2 * block.d_state]
    delta = F.softplus(block.dt_proj(dt))
    h = h * torch.exp(-torch.einsum("ne,es->nes", delta, block.A_log.exp()))
    h = h + torch.einsum("ne,ne,ns->nes", delta, u, B)
    y = torch.einsum("nes,ns->ne", h, C) + u * block.D_skip
    return [block.out_proj(z * z.sigmoid() * y), seen[:, -3:], h]


def live_dancer_by_dancer(x, past, h, block):
    d_inner, rank = len(block.D_skip), block.dt_proj.in_features
    outs, kept, states = [], [], []
    for k in range(len(x)):
        both = block.in_proj.weight @ x[k]
        u, gate = both[:d_inner], both[d_inner:]
        kept.append(stack([past[k, 1], past[k, 2], u]))
        weight = block.conv.weight[:, 0]
        u = block.conv.bias + sum(weight[:, j] * past[k, j] for j in range(3)) + weight[:, 3] * u
        u = u / (1 + torch.exp(-u))
        made = block.x_proj.weight @ u
        delta = torch.log1p(torch.exp(block.dt_proj(made[:rank])))
        B, C = made[rank : rank + block.d_state], made[rank + block.d_state :]
        states.append(
            torch.exp(-delta[:, None] * block.A_log.exp()) * h[k] + torch.outer(delta * u, B)
        )
        outs.append(block.out_proj((states[-1] @ C + block.D_skip * u) * F.silu(gate)))
    return stack(outs), stack(kept), stack(states)


# 09 · Changing places


def order_by_permuting(S1, S2):
    return tensor([S1[k].item() for k in S2.tolist()])


def order_from_the_right(x, S, gap):
    y, order = x.clone(), S.tolist()
    for left, right in reversed(list(itertools.pairwise(order))):
        y[left] = min(y[left], y[right] - gap)
    return y - y.mean() + x.mean()


def order_only_if_needed(x, S, gap):
    if (x[S].diff() >= gap).all():
        return x
    y = torch.empty_like(x)
    y[S] = gap * 1.5 * torch.arange(len(x))
    return y - y.mean() + x.mean()


def velocity_by_shifting(root):
    before = cat([root[:, :1], root[:, :-1]], 1)
    return (root - before)[..., ::2] / (1 / 30)


def velocity_in_numpy(root):
    floor = root.numpy()[:, :, [0, 2]]
    return np.diff(floor, axis=1, prepend=floor[:, :1]) * 30


def adapt_by_recursion(x_raw, layers, legs):
    """Every layer by a call of its own."""

    def csl(k, x, v):
        at = layers[k]
        x = (x @ at["W"] + at["b"]) / (1 + torch.exp(-(v @ at["Wg"]) - at["bg"])) + v @ at["Wb"]
        return x if k == 2 else csl(k + 1, torch.where(x > 0, x, 0.01 * x), v)

    floor = x_raw[..., 4:7:2]
    v = 30 * (floor - cat([floor[:, :1], floor[:, :-1]], 1))
    x_a = csl(0, x_raw, torch.minimum(torch.maximum(v, tensor(-3.0)), tensor(3.0)))
    return torch.where(torch.isin(torch.arange(x_raw.shape[-1]), tensor(legs)), x_a, x_raw)


def adapt_by_library(x_raw, layers, legs):
    csl = [ConcatSquashLinear(*layer["W"].shape, d_cond=2) for layer in layers]
    for one, layer in zip(csl, layers, strict=True):
        weights = {"linear.weight": "W", "gate.weight": "Wg", "shift.weight": "Wb"}
        state = {name: layer[key].T for name, key in weights.items()}
        one.load_state_dict(state | {"linear.bias": layer["b"], "gate.bias": layer["bg"]})
    v = ground_velocity(x_raw)
    x_a = csl[2](F.leaky_relu(csl[1](F.leaky_relu(csl[0](x_raw, v)), v)), v)
    return x_raw.index_copy(-1, tensor(legs), x_a[..., legs])


# 10 · A long group dance


def join_from_behind(segments, overlap):
    stride = segments[0].shape[1] - overlap
    n, f, d = segments[0].shape
    out = zeros(n, f + (len(segments) - 1) * stride, d)
    for k in reversed(range(len(segments))):
        out[:, k * stride : k * stride + f] = segments[k]
    return out


def join_two_and_two(segments, overlap):
    dance = segments[0]
    for segment in list(segments)[1:]:
        dance = cat([dance, segment[:, overlap:]], 1)
    return dance


def all_turn_right_back(first):
    last, step = first[:, -1:], first[:, -1:] - first[:, -2:-1]
    return last - step * torch.arange(30)[:, None]


def all_march_aside(first):
    """At right angles to how they came, and a little faster."""
    last, step = first[:, -1:], first[:, -1:] - first[:, -2:-1]
    aside = stack([-step[..., 2], 0 * step[..., 1], step[..., 0]], -1)
    return last + 1.5 * aside * torch.arange(30)[:, None]


def assign_by_loop(start, places):
    best, found = math.inf, None
    for goes in itertools.permutations(range(len(start))):
        way = sum((start[i] - places[k]).norm().item() for i, k in enumerate(goes))
        if way < best:
            best, found = way, goes
    return list(found)


def assign_by_scipy(start, places):
    from scipy.optimize import linear_sum_assignment

    return linear_sum_assignment(torch.cdist(start, places).numpy())[1]


def long_dance_by_library(guess, root_x, noise, times, abar, overlap):
    class Sampler(LongGroupSampler):
        def first_input(self, segment, before):
            return noise[segment.number]

    k, *shape = noise.shape
    starts = (shape[1] - overlap) * torch.arange(k)

    def bind(conditions):
        start = int(conditions.music[0, 0, 0])
        return lambda x, t: guess(x[0], t, start)[None]

    return Sampler(
        shape=tuple(shape),
        bind=bind,
        music=starts[:, None, None],
        root_x=root_x,
        options=SamplerOptions(abar, "ddim", len(times) - 1, eta=0.0, clamp=None),
        overlap=overlap,
        pinning="same_noise",
        seam="copy",
    ).dance()


def long_dance_in_place(guess, root_x, noise, times, abar, overlap):
    """The dance lies there from the first; each step mixes known and free frames at once."""
    k, n, f, d = noise.shape
    stride = f - overlap
    dance = noise.new_zeros(n, f + (k - 1) * stride, d)
    for i in range(k):
        here = dance[:, i * stride : i * stride + f]
        order = sorted(range(n), key=lambda dancer: root_x(here[:, 0])[dancer].item())
        known, held = here[order].clone(), overlap if i else 0
        x = noise[i].clone()
        for t, t_next in itertools.pairwise(times):
            a = float(abar[t])
            mixed = math.sqrt(a) * known + math.sqrt(1 - a) * noise[i]
            x[:, :held] = mixed[:, :held]
            x_0 = guess(x, t, i * stride)
            b = 1.0 if t_next < 0 else float(abar[t_next])
            x = math.sqrt(b) * x_0 + math.sqrt((1 - b) / (1 - a)) * (x - math.sqrt(a) * x_0)
        if i == 0:
            dance[:, :f] = x[root_x(x[:, 0]).argsort()]
        for row, dancer in enumerate(order if i else ()):
            dance[dancer, i * stride + overlap : i * stride + f] = x[row, overlap:]
    return dance


# 11 · Think in phrases


def valleys_in_a_loop(v):
    return [i for i in range(1, len(v) - 1) if v[i - 1] > v[i] <= v[i + 1]]


def valleys_by_signs(v):
    step = v.diff()
    return torch.where((step[:-1] < 0) & (step[1:] >= 0))[0] + 1


def ripple_up_and_down(frames):
    t, k = np.arange(frames)[:, None] / 30, np.arange(24)
    joints = np.zeros((frames, 24, 3))
    joints[..., 1] = 0.3 * np.cos(np.pi * t - np.pi * k / 24)
    return joints


def hard_frames_by_rows(N, n):
    rows = [torch.arange(k * n - 4, k * n + 4) for k in range(1, N // n)]
    return stack([torch.arange(8), *rows, torch.arange(N - 8, N)])


def hard_frames_by_clamping(N, n):
    return torch.arange(0, N + 1, n).clamp(4, N - 4)[:, None] + torch.arange(-4, 4)


def forget_axis_by_axis(root):
    out = root.clone()
    for axis in (0, 2):
        out[:, :, axis] = root[:, :, axis] - root[:, :1, axis]
    return out


def forget_by_steps(root):
    steps = root.diff(dim=1, prepend=root[:, :1])
    return cat([steps.cumsum(1)[..., :1], root[..., 1:2], steps.cumsum(1)[..., 2:]], -1)


def plan_by_library(rests, energy, N, n):
    return primitive_frames(rests, Layout(N, n), np.asarray(energy))


def plan_by_masks(rests, energy, N, n):
    frame, allowed = torch.arange(N), torch.zeros(N, dtype=torch.bool)
    allowed[list(rests)] = True
    allowed &= (frame % n >= 12) & (frame % n <= n - 12)
    rows = [torch.arange(8)]
    for local in range(N // n):
        before = -99
        for half in range(2 * local, 2 * local + 2):
            fit = allowed & (frame // (n // 2) == half) & (frame >= before + 8)
            full = energy.masked_fill(~fit, -1.0)
            before = int(full.argmax()) if fit.any() else half * n // 2 + n // 4
            rows.append(torch.arange(before - 4, before + 4))
        rows.append(torch.arange(n * (local + 1) - 4, n * (local + 1) + 4))
    rows[-1] = rows[-1] - 4
    return stack(rows)


# 12 · Fill in the rest


def mirror_by_signs(R, swap):
    signs = tensor([[1.0, -1, -1], [-1, 1, 1], [-1, 1, 1]])
    return signs * R[:, swap]


def mirror_by_einsum(R, swap):
    D = tensor([-1.0, 1.0, 1.0])
    return torch.einsum("i,fjik,k->fjik", D, R[:, swap], D)


def held_step_by_step(times, s):
    count, T = 0, times[0] + 1
    for begin, end in itertools.pairwise(times):
        if end != -1 and begin + 1 > T * (1 - s):
            count += 1
    return count


def join_by_fading(paths):
    """Steps near a seam: from one side's to the other's by a cosine."""
    n = paths.shape[1]
    step = paths.diff(dim=1, prepend=paths[:, :1]).flatten()
    s = (1 - torch.cos(math.pi * torch.arange(1, 16) / 16)) / 2
    for seam in range(n, len(step), n):
        a, b = step[seam - 8].item(), step[seam + 8].item()
        step[seam - 7 : seam + 8] = a + (b - a) * s
    return (paths[0, 0] + step.cumsum(0)).numpy()


def critic_by_clamping(real, made):
    return 0.5 * (1 - real).clamp(min=0).mean() + 0.5 * (1 + made).clamp(min=0).mean()


def critic_by_torch(real, made):
    real_side = F.hinge_embedding_loss(real, -torch.ones_like(real), margin=1.0)
    made_side = F.hinge_embedding_loss(-made, -torch.ones_like(made), margin=1.0)
    return (real_side + made_side) / 2


def round_by_optimizers(local, D, W, V, batch, weight, rate):
    W, V = nn.Parameter(W.clone()), nn.Parameter(V.clone())
    x_0, x_t, M, g = batch["x_0"], batch["x_t"], batch["M"], batch["g"]
    mine = F.one_hot(g, D(V, x_0, M).shape[1])
    fake, real = (mine * D(V, x, M) for x in (local(W, x_t, M).detach(), x_0))
    sides = F.relu(mine - real) + F.relu(mine + fake)
    (sides.sum() / len(g) / 2).backward()
    torch.optim.SGD([V], lr=rate).step()
    made = local(W, x_t, M)
    (F.mse_loss(made, x_0) - weight * (mine * D(V, made, M)).sum() / len(g)).backward()
    torch.optim.SGD([W], lr=rate).step()
    return W, V


def round_dance_by_dance(local, D, W, V, batch, weight, rate):
    W, V, b = W.clone().requires_grad_(), V.clone().requires_grad_(), len(batch["g"])

    def verdict(V, x, i):
        return D(V, x[None], batch["M"][i : i + 1])[0, batch["g"][i]]

    def guess(i):
        return local(W, batch["x_t"][i : i + 1], batch["M"][i : i + 1])[0]

    content = sum(verdict(V, batch["x_0"][i], i).clamp(max=1) for i in range(b))
    content = content - sum(verdict(V, guess(i), i).clamp(min=-1) for i in range(b))
    V = V.detach() + rate * torch.autograd.grad(content / (2 * b), V)[0]
    error = sum((guess(i) - batch["x_0"][i]).pow(2).mean() for i in range(b))
    loss = (error - weight * sum(verdict(V, guess(i), i) for i in range(b))) / b
    return [W.detach() - rate * torch.autograd.grad(loss, W)[0], V]


# 13 · Can you measure a dance?


def skates_in_centimetres(foot):
    step = foot[1:] - foot[:-1]
    return torch.hypot(step[..., 0], step[..., 2]).amax(1) > 0.01


def skates_by_squares(foot):
    vx, _, vz = (30 * (foot[1:] - foot[:-1])).unbind(-1)
    fast = vx**2 + vz**2 > 0.09
    return fast[:, 0] | fast[:, 1]


def statue_in_the_middle(dance):
    still = dance.pose[:, 60:61].repeat(1, dance.pose.shape[1], 1, 1, 1)
    return Motion(still, 0 * dance.root)


def slow_motion(dance):
    """The first second, in as many frames as the whole dance has."""
    frames = (torch.arange(dance.root.shape[1]) * 0 + 3).long()
    return replace(dance, pose=dance.pose[:, frames], root=dance.root[:, frames])


def rhythm_by_product(music, motion):
    return closeness(music, motion, 0.1) * closeness(motion, music, 0.1)


def move_aside(dance):
    return replace(dance, root=dance.root - tensor([0.0, 0.0, 40.0]))


def move_up(dance):
    return Motion(dance.pose, dance.root + tensor([0.0, 60.0, 0.0]))


def frechet_by_eigenvalues(x, r):
    """The trace of a root is the sum of the eigenvalues' roots, symmetric or not."""
    s = r.std(0, correction=0)
    s = torch.where(s < 1e-8, torch.ones_like(s), s)
    a, b = ((v - r.mean(0)) / s for v in (x, r))
    centred = [(v - v.mean(0)) / math.sqrt(len(v) - 1) for v in (a, b)]
    S, S_r = (v.T @ v for v in centred)
    shared = torch.linalg.eigvals(S @ S_r).real.clamp_min(0).sqrt().sum()
    return float((a.mean(0) - b.mean(0)).pow(2).sum() + S.trace() + S_r.trace() - 2 * shared)


def frechet_by_scipy(x, r):
    from scipy.linalg import sqrtm

    mean, s = r.numpy().mean(0), r.numpy().std(0)
    s[s < 1e-8] = 1
    a, b = (x.numpy() - mean) / s, (r.numpy() - mean) / s
    S, S_r = np.cov(a.T), np.cov(b.T)
    half = sqrtm(S).real
    product = half @ S_r @ half
    values = np.linalg.eigvalsh((product + product.T) / 2).clip(0)
    return ((a.mean(0) - b.mean(0)) ** 2).sum() + np.trace(S + S_r) - 2 * np.sqrt(values).sum()


def frechet_by_factors(x, r):
    """Singular values of the centred samples' product, without any root of a matrix."""
    s = r.std(0, correction=0).clamp_min(1e-8)
    s[s == 1e-8] = 1
    a, b = (x - r.mean(0)) / s, (r - r.mean(0)) / s
    A, B = ((v - v.mean(0)) / (len(v) - 1) ** 0.5 for v in (a, b))
    shared = torch.linalg.svdvals(A @ B.T).sum()
    return (a.mean(0) - b.mean(0)).square().sum() + A.square().sum() + B.square().sum() - 2 * shared


# 14 · What came before


def roll_in_one_row(step, seed, frames):
    dance, s = seed.clone(), seed.shape[1]
    while dance.shape[1] < s + frames:
        dance = cat([dance, step(dance[:, -s:])[:, 0][:, None]], dim=1)
    return dance[:, s:]


def roll_by_rolling(step, seed, frames):
    history, made = seed.clone(), zeros(len(seed), frames, seed.shape[-1])
    for k in range(frames):
        made[:, k] = step(history)[:, 0]
        history = history.roll(-1, 1)
        history[:, -1] = made[:, k]
    return made


def perplexity_by_unique(codes, num_codes):
    _, counts = np.unique(codes.numpy(), return_counts=True)
    p = counts / counts.sum()
    return float(np.prod(p**-p))


def write_by_searching(logits, start, draws, top, tau):
    words = start.clone()
    for unit in draws.T:
        choice = []
        for i, draw in enumerate(unit):
            score = logits(words[: i + 1]) / tau
            best = score.argsort(descending=True)[:top]
            sums = score[best].softmax(0).cumsum(0)  # of those that stay, so already divided
            place = torch.searchsorted(sums, draw.item(), right=True).clamp(max=top - 1)
            choice.append(best[place].item())
        words = cat([words, tensor(choice)[:, None]], dim=1)
    return words[:, -draws.shape[1] :]


def write_dancer_by_dancer(logits, start, draws, top, tau):
    """To the end, before the next dancer begins: nobody hears those behind."""
    s, rows = start.shape[1], []
    for k in range(len(start)):
        own = start[k]
        for draw in draws[k]:
            heard = stack([*(words[: len(own)] for words in rows), own])
            p, best = (logits(heard) / tau).exp().topk(top)
            new = best[p.cumsum(0) > draw * p.sum()][:1]
            own = cat([own, new])
        rows.append(own)
    return stack(rows)[:, s:]


def write_word_by_word(logits, start, draws, top, tau):
    """In numpy; a dancer's words are written behind its own."""
    n, s = start.shape
    words = np.concatenate([start.numpy(), np.zeros(draws.shape, dtype=int)], axis=1)
    for at in range(s, words.shape[1]):
        for i in range(n):
            heard = tensor(words[: i + 1, :at])
            weight = np.exp(logits(heard).double().numpy() / tau)
            order = np.argsort(-weight)[:top]
            left = draws[i, at - s].item() * weight[order].sum()
            for code in order:
                words[i, at] = code
                left -= weight[code]
                if left < 0:
                    break
    return words[:, s:]


# 15 · Live


def steer_by_next(begin, wishes):
    stream, pieces = begin(), []
    while True:
        if len(pieces) in wishes:
            stream.set(**wishes[len(pieces)])
        try:
            pieces.append(next(stream))
        except StopIteration:
            return pieces


def steer_by_counting(begin, wishes):
    stream = begin()
    stream.set(**wishes.get(0, {"energy": 1.0}))
    pieces = []
    for k, piece in enumerate(stream, start=1):
        pieces += [piece]
        if k in wishes:
            stream.set(**wishes[k])
    return tensor(pieces)


def most_overlap_by_trying(frames, seconds):
    overlap = frames
    while (frames - overlap) / 30 < seconds:
        overlap -= 1
    return overlap


def beats_in_a_loop(past, now, until):
    gaps = sorted(b - a for a, b in itertools.pairwise(past[-8:]))
    found, beat = [], past[-1]
    while (beat := beat + gaps[len(gaps) // 2]) <= until:
        if beat > now:
            found.append(beat)
    return found


def play_by_differences(costs, frames, steps, lead):
    """Fills a table; what is played is where the last row began, and how long it lasts."""
    table = zeros(len(costs), 4, dtype=torch.float64)
    table[0] = tensor([0.0, steps * costs[0], steps * costs[0], steps])
    for k in range(1, len(costs)):
        played = table[k - 1, 2] + frames[k - 1] / 30
        table[k, 3] = steps
        table[k, 0] = torch.maximum(table[k - 1, 1], played - lead)
        table[k, 1] = table[k, 0] + steps * costs[k]
        table[k, 2] = torch.maximum(table[k, 1], played)
        if table[k, 2] > played:
            steps = max(4, int(steps / 2))
    return table


def play_by_waiting(costs, frames, steps, lead):
    """Counts all waiting so far: the dance is shown that much later than it would be."""
    rows, now, waited, danced = [], 0.0, 0.0, 0.0
    for cost, n in zip(costs, frames, strict=True):
        left = waited + danced - now
        begun = now + max(left - lead, 0)
        now = begun + cost * steps
        late = now - waited - danced
        waited += max(late, 0)
        rows.append([begun, now, waited + danced, steps])
        steps = max(steps // 2, 4) if late > 0 and danced > 0 else steps
        danced += n / 30
    return rows


# 16 · Your own TCDiff++


def fuse_frame_by_frame(h, mix):
    frames = [mix(cat(frame.unbind(1), dim=-1)) for frame in h.unbind(2)]
    return stack([stack(row.chunk(h.shape[1], dim=-1), dim=1) for row in frames], dim=2)


def ssd_as_a_loop(u, a, B, C):
    state, y = zeros(len(u), B.shape[-1], u.shape[-1]), []
    for i in range(u.shape[1]):
        state = a[:, i, None, None].exp() * state + B[:, i, :, None] * u[:, i, None]
        y.append((C[:, i, :, None] * state).sum(1))
    return stack(y, dim=1)


def ssd_by_scan(u, a, B, C):
    """The library's scan, with frames that last -a."""
    last = (-a)[..., None]
    return ssd_scan(u / last, last, -torch.ones(1), B, C, torch.zeros(1))


def luck_by_pascal(wins, songs):
    chances = np.ones(1)
    for _ in range(songs):
        chances = np.convolve(chances, [0.5, 0.5])
    return chances[wins:].sum()


def luck_by_scipy(wins, songs):
    return stats.binom.sf(wins - 1, songs, 0.5)


def compare_draw_by_draw(mine, other, draws):
    table = []
    for column in range(mine.shape[1]):
        pairs = [(a, b) for a, b in zip(mine[:, column], other[:, column], strict=True)]
        pairs = [(a, b) for a, b in pairs if not math.isnan(a) and not math.isnan(b)]
        k, gaps = len(pairs), []
        for draw in draws:
            a, b = zip(*(pairs[math.floor(k * u)] for u in draw[:k]), strict=True)
            gaps.append(sum(a) / k - sum(b) / k)
        a, b = (sum(values) / k for values in zip(*pairs, strict=True))
        table.append([a, a - b, np.percentile(gaps, 2.5), np.percentile(gaps, 97.5)])
    return table


def compare_by_counts(mine, other, draws):
    """A draw's mean is a weighted one: how often each song came."""
    rows = []
    for column, gaps in zip(tensor(mine).T, tensor(mine - other).T, strict=True):
        a, gap = column[gaps.isfinite()], gaps[gaps.isfinite()]
        k = len(gap)
        counts = F.one_hot((k * tensor(draws)[:, :k]).long(), k).sum(1)
        means = counts.double() @ gap / k
        ends = means.quantile(tensor([0.025, 0.975], dtype=torch.float64))
        rows.append(cat([stack([a.mean(), gap.mean()]), ends]))
    return stack(rows)


OTHER_WAYS = {
    "00.3": [song_by_clock, song_of_noise],
    "01.2": [hand_by_world_rotations, hand_slightly_bent],
    "01.3": [six_in_a_loop, six_by_crosses],
    "01.4": [
        lambda: (tensor([0.0, 1, 0, 0.004, 1, 0]), tensor([0.0, 1, 0, -0.004, 1, 0])),
        lambda: np.array([[3.0, 0, 0, -3, 0, 0.005], [3.0, 0, 0, -3, 0, -0.005]]),
    ],
    "01.5": [resample_frame_by_frame, resample_by_quaternions],
    "02.1": [tones_cross, lambda: torch.tensor([[-30.0, -80.0], [-60.0, -10.0]] * 64)],
    "02.2": [
        tempo_from_sorted_gaps,
        lambda M: 1800 / (M[:, -1] == 1).nonzero()[:, 0].diff().median(),
    ],
    "02.4": [
        lambda sound, starts, features: features(sound)[
            np.asarray(starts)[:, None] + np.arange(150)
        ],
        lambda sound, starts, features: [M[s:][:150] for M in [features(sound)] for s in starts],
    ],
    "02.6": [
        stretches_by_arrays,
        lambda beats, seconds: [
            [a, b] for a, b in zip([0, *beats], [*beats, seconds], strict=True) if b > a + 2.2
        ],
    ],
    "02.7": [track_forwards, track_from_the_end],
    "03.1": [
        lambda height: (9.81 / (2 * height[1:-1] - height[2:] - height[:-2]).median()).sqrt(),
        lambda height: math.sqrt(
            -9.81 / (2 * np.polyfit(np.arange(len(height)), height.numpy(), 2)[0])
        ),
    ],
    "03.2": [
        leaks_by_frames,
        lambda train, test: sum(
            min((abs(s - k) for b, k in train if b == a), default=150) < 150 for a, s in test
        ),
    ],
    "03.3": [split_by_union_find, lambda takes: tuple(split_by_union_find(takes))],
    "03.4": [
        rescale_flat,
        lambda train, new: (
            (new - train.amin((0, 1))) / ((train.amax((0, 1)) - train.amin((0, 1))) / 2) - 1
        ),
    ],
    "03.5": [up_by_votes, up_by_products],
    "04.1": [
        lambda x_t, eps, t, abar: x_t * abar[t] ** -0.5 - eps * (1 / abar[t] - 1).sqrt(),
        lambda x_t, eps, t, abar: (x_t - eps * math.sqrt(1 - abar[t])) / math.sqrt(abar[t]),
    ],
    "04.2": [
        lambda x_s, s, t, abar, eps: (
            (abar[t] / abar[s]) ** 0.5 * x_s + ((abar[s] - abar[t]) / abar[s]) ** 0.5 * eps
        ),
        lambda x_s, s, t, abar, eps: (
            abar[t].sqrt() / abar[s].sqrt() * x_s
            + (1 - abar[t] - (abar[t] / abar[s]) * (1 - abar[s])).sqrt() * eps
        ),
    ],
    "04.4": [
        lambda eps, abar: (960, eps - 0.1),
        lambda eps, abar: (tensor(955), eps + 0.0999 * eps / eps.square().mean().sqrt()),
    ],
    "04.5": [
        lambda num_steps: 1 - torch.linspace(0.01, 0.9999, num_steps),
        lambda num_steps: (0.99 - np.arange(num_steps) * 0.9895 / (num_steps - 1)).tolist(),
    ],
    "04.6": [training_step_by_torch, training_step_dance_by_dance],
    "05.2": [distance_in_a_loop, distance_by_variance],
    "05.3": [far_circle, upstairs],
    "05.4": [layer_by_torch, layer_token_by_token],
    "06.1": [
        lambda net, x_t, w: w * net(x_t, music=True) + (1 - w) * net(x_t, music=False),
        lambda net, x_t, w: torch.lerp(
            net(x_t, music=False), net(x_t, music=True), torch.tensor(float(w))
        ),
    ],
    "06.2": [
        clip_by_minimum,
        lambda x, mean, std, C: C.T @ (4 * std * (C @ (x - mean) / (4 * std)).clamp(-1, 1)) + mean,
    ],
    "06.3": [soft_landing, cosine_landing],
    "06.4": [walk_by_library, walk_down],
    "07.1": [attention, hears_the_others],
    "07.3": [ranks_by_counting, ranks_in_a_loop],
    "07.4": [mark_in_a_loop, mark_in_frames],
    "07.5": [prior_by_loops, prior_by_svd],
    "08.1": [kernel_step_by_step, kernel_by_einsum],
    "08.2": [forgets_once, forgets_a_little_always],
    "08.4": [
        remember_one_by_one,
        lambda tokens, n, memory: (
            memory(tokens.unflatten(0, (-1, n)).movedim(1, 0)).movedim(0, 1).flatten(0, 1)
        ),
    ],
    "08.5": [live_by_einsum, live_dancer_by_dancer],
    "09.1": [order_by_permuting, lambda S1, S2: S1.gather(0, S2)],
    "09.2": [order_from_the_right, order_only_if_needed],
    "09.3": [velocity_by_shifting, velocity_in_numpy],
    "09.4": [adapt_by_recursion, adapt_by_library],
    "10.1": [join_from_behind, join_two_and_two],
    "10.2": [all_turn_right_back, all_march_aside],
    "10.3": [assign_by_loop, assign_by_scipy],
    "10.4": [long_dance_by_library, long_dance_in_place],
    "11.1": [valleys_in_a_loop, valleys_by_signs],
    "11.2": [ripple_up_and_down, lambda frames: torch.as_tensor(ripple_up_and_down(frames)) + 1],
    "11.3": [hard_frames_by_rows, hard_frames_by_clamping],
    "11.4": [forget_axis_by_axis, forget_by_steps],
    "11.6": [plan_by_library, plan_by_masks],
    "12.1": [mirror_by_signs, mirror_by_einsum],
    "12.2": [
        held_step_by_step,
        lambda times, s: len([t for t in times[:-2] if t >= times[0] - s * (times[0] + 1) + 1e-9]),
    ],
    "12.4": [join_by_fading, lambda paths: torch.as_tensor(join_by_fading(paths))],
    "12.5": [critic_by_clamping, critic_by_torch],
    "12.6": [round_by_optimizers, round_dance_by_dance],
    "13.1": [skates_in_centimetres, skates_by_squares],
    "13.2": [statue_in_the_middle, slow_motion],
    "13.3": [
        rhythm_by_product,
        lambda music, motion: np.minimum(
            closeness(music, motion, 0.1), closeness(motion, music, 0.1)
        ),
    ],
    "13.5": [move_aside, move_up],
    "13.6": [frechet_by_eigenvalues, frechet_by_scipy, frechet_by_factors],
    "14.1": [roll_in_one_row, roll_by_rolling],
    "14.2": [
        lambda z, e: torch.cdist(z, e.expand(len(z), -1, -1)).argmin(2),
        lambda z, e: (e.square().sum(-1) - 2 * z @ e.T).argmin(-1),
    ],
    "14.3": [
        perplexity_by_unique,
        lambda codes, k: (
            torch.distributions.Categorical(torch.bincount(codes.flatten(), minlength=k).float())
            .entropy()
            .exp()
        ),
    ],
    "14.5": [write_by_searching, write_dancer_by_dancer, write_word_by_word],
    "15.1": [steer_by_next, steer_by_counting],
    "15.3": [
        most_overlap_by_trying,
        lambda frames, seconds: frames - math.ceil(30 * seconds),
    ],
    "15.4": [
        beats_in_a_loop,
        lambda past, now, until: tensor(beats_in_a_loop(past, now, until)),
    ],
    "15.5": [play_by_differences, play_by_waiting],
    "16.1": [
        fuse_frame_by_frame,
        lambda h, mix: mix(h.movedim(2, 1).flatten(2)).unflatten(2, h.shape[1::2]).movedim(2, 1),
    ],
    "16.2": [
        ssd_as_a_loop,
        ssd_by_scan,
    ],
    "16.3": [luck_by_scipy, luck_by_pascal],
    "16.4": [compare_draw_by_draw, compare_by_counts],
}
