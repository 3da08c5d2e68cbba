"""Plausible wrong answers to the exercises of lesson 12: Fill in the rest."""

import torch

from dancediff.exercises import EXERCISES


def slowly_astray(paths):
    """Right, and 5 cm further off at the end: every step is a little longer."""
    right = EXERCISES["12.4"].spec(paths)
    return right + torch.linspace(0, 0.05, len(right))


def added_up(paths, *, meet=False, fade=False):
    """Steps added up; at a seam none, the mean of both sides, or (all along a walk) a slow fade."""
    step = paths.diff(dim=1, prepend=paths[:, :1])
    if meet:
        step[1:, 0] = (step[:-1, -1] + step[1:, 1]) / 2
    if fade:
        step = torch.nn.functional.avg_pool1d(step.flatten()[None], 31, 1, 15)[0]
    return paths[0, 0] + step.flatten().cumsum(0)


def shifted(paths):
    """Each walk begins where the one before ended; a frame of standing still at every seam."""
    ends = (paths[:-1, -1] - paths[1:, 0]).cumsum(0)
    return (paths + torch.cat([torch.zeros(1), ends])[:, None]).flatten()


def own_genre(verdicts, g):
    return verdicts[torch.arange(len(g)), g]


def hinge(real, fake):
    return ((1 - real).relu() + (1 + fake).relu()).mean() / 2


def play(
    *,
    verdict=own_genre,
    critic=hinge,
    genre=lambda fake: -fake.mean(),
    error=torch.mean,
    judge="new",
):
    """A round with one part replaced; with none it is right."""

    def answer(local, D, W, V, batch, weight, rate):
        x_0, M, g = batch["x_0"], batch["M"], batch["g"]
        W, V = W.clone().requires_grad_(), V.clone().requires_grad_()

        def guessed():
            return local(W, batch["x_t"], M)

        def generator(V):
            push = genre(verdict(D(V, guessed(), M), g))
            loss = error((guessed() - x_0).square()) + weight * push
            return (W - rate * torch.autograd.grad(loss, W)[0]).detach()

        moved = generator(V)
        made = local(moved, batch["x_t"], M) if judge == "first" else guessed()
        made = batch["x_t"] if judge == "noise" else made
        loss = critic(verdict(D(V, x_0, M), g), verdict(D(V, made, M), g))
        V = (V - rate * torch.autograd.grad(loss, V)[0]).detach()
        return generator(V) if judge in ("new", "noise") else moved, V

    return answer


def spoils_what_it_is_given(local, D, W, V, batch, weight, rate):
    moved = play()(local, D, W, V, batch, weight, rate)
    return W.copy_(moved[0]), V.copy_(moved[1])


NEAR_MISSES = {
    "12.1": [
        lambda R, swap: R[:, swap],  # partners, seen from the same side
        lambda R, swap: torch.diag(torch.tensor([-1.0, 1, 1])) @ R[:, swap],  # no rotation
        lambda R, swap: (
            torch.diag(torch.tensor([-1.0, 1, 1])) @ R @ torch.diag(torch.tensor([-1.0, 1, 1]))
        ),  # nobody changes sides
        lambda R, swap: R[:, swap] * torch.tensor([-1.0, 1, 1]),
        lambda R, swap: R[:, swap].mT,
        lambda R, swap: (
            torch.diag(torch.tensor([1.0, 1, -1]))
            @ R[:, swap]
            @ torch.diag(torch.tensor([1.0, 1, -1]))
        ),  # the mirror stands at z = 0
        lambda R, swap: R[:, swap] @ torch.diag(torch.tensor([-1.0, 1, 1])),  # one side
        lambda R, swap: -R[:, swap],
    ],
    "12.2": [
        lambda times, s: sum(t > 50 * (1 - s) for t in times[:-2]),  # the released code
        lambda times, s: sum(t + 1 > (times[0] + 1) * s for t in times[:-2]),  # 1 - s
        lambda times, s: round(s * (len(times) - 1)),  # a share of the steps, not of the way
        lambda times, s: sum(t + 1 > (times[0] + 1) * (1 - s) for t in times[:-1]),  # the last, too
        lambda times, s: sum(t + 1 > 1000 * (1 - s) for t in times[1:-1]),  # where they end
        lambda times, s: sum(t > (times[0] + 1) * (1 - s) for t in times[:-2]),  # t for t + 1
        lambda times, s: sum(t + 1 >= (times[0] + 1) * (1 - s) for t in times[:-2]),  # as many
        lambda times, s: sum(t + 1 > times[0] * (1 - s) for t in times[:-2]),  # T - 1 for T
        lambda times, s: int(s * 1000),
        lambda times, s: sum(t + 1 > 1000 * (1 - s) for t in times[:-2]),  # T is always 1000
    ],
    "12.3": [
        {
            "a hard cue": True,
            "the frame beside a hard cue": False,
            "a soft cue, s = 0.5": False,
            "a soft cue, s = 1": True,  # "at every step", but the last
        },
        {
            "a hard cue": True,
            "the frame beside a hard cue": True,  # pasting does not spread
            "a soft cue, s = 0.5": False,
            "a soft cue, s = 1": False,
        },
        {
            "a hard cue": False,  # the last step is followed by the hard cues, too
            "the frame beside a hard cue": False,
            "a soft cue, s = 0.5": False,
            "a soft cue, s = 1": False,
        },
        {"hard": True, "soft": False},
    ],
    "12.4": [
        lambda paths: paths.flatten(),  # glued
        slowly_astray,
        shifted,  # no jump, but one step of nothing, and a kink
        added_up,  # the same
        lambda paths: added_up(paths, meet=True),  # half a kink, twice
        lambda paths: added_up(paths, fade=True),  # smooth, and every step is another
        lambda paths: added_up(paths, meet=True) - paths[0, 0],  # begins at 0
    ],
    "12.5": [
        lambda real, made: -0.5 * (real - made).mean(),  # never content
        lambda real, made: 0.5 * ((1 + real).relu() + (1 - made).relu()).mean(),  # the other way
        lambda real, made: ((1 - real).relu() + (1 + made).relu()).mean(),  # twice as much
        lambda real, made: 0.5 * ((1 - real).relu() + (1 + made).relu()),  # one for each dance
        lambda real, made: 0.5 * ((-real).relu() + made.relu()).mean(),  # without the margin
        lambda real, made: 0.5 * ((1 - real).relu() + (1 + made).relu()).sum(),
        lambda real, made: 0.5 * ((1 - real) + (1 + made)).mean(),  # below 0, too
        lambda real, made: 0.5 * (1 - real).relu().mean(),  # real ones only
    ],
    "12.6": [
        play(judge="old"),  # both learn at once
        play(judge="first"),  # the local model first
        play(judge="noise"),  # the critic sees the input, not the guess
        play(verdict=lambda verdicts, g: verdicts),  # of all genres
        play(verdict=lambda verdicts, g: verdicts[:, 0]),  # of the first
        play(verdict=lambda verdicts, g: verdicts.max(1).values),  # of the best
        play(critic=lambda real, fake: 2 * hinge(real, fake)),
        play(critic=lambda real, fake: hinge(fake, real)),  # calls made dances real
        play(critic=lambda real, fake: (fake - real).mean() / 2),  # never content
        play(critic=lambda real, fake: (1 - real).relu().mean() / 2),  # real ones only
        play(genre=lambda fake: fake.mean()),  # wants to be found out
        play(genre=lambda fake: (1 - fake).relu().mean()),  # content with 1
        play(genre=lambda fake: -fake.sum()),
        play(error=torch.sum),
        play(error=lambda squares: 0),  # forgets the true dance
        play(critic=lambda real, fake: -hinge(real, fake)),  # up the gradient
        lambda *given: play()(*given)[::-1],  # V first
        lambda *given: (play()(*given)[0], given[3]),  # the critic does not learn
        spoils_what_it_is_given,
    ],
}
