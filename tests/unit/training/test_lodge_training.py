import csv
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from dancediff import hub
from dancediff.data.augment import Augmentation
from dancediff.data.choreographed import make_choreographed
from dancediff.data.prepare import prepare
from dancediff.data.take import DanceTake, Job
from dancediff.data.windows import SoloCut, WindowSampler
from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions.level_weights import level_weights
from dancediff.extensions.metre_unit import FLOOR_UNIT
from dancediff.extensions.preconditioning import preconditioning_of
from dancediff.genre import FINEDANCE
from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import LODGE, with_hands
from dancediff.music.features import CHROMA
from dancediff.papers.lodge.genre_discriminator import DiscriminatorConfig
from dancediff.papers.lodge.global_diffusion import GlobalConfig
from dancediff.papers.lodge.losses import LodgeWeights, l_genre
from dancediff.papers.lodge.model import Lodge
from dancediff.papers.lodge.primitives import LAYOUT, Layout, primitives_of
from dancediff.training import lodge as lodge_training
from dancediff.training.checkpoint import load_extra
from dancediff.training.config import SoloData, TrainConfig, TrainingExtensions
from dancediff.training.group_takes import prepared_takes, tell_other_genres
from dancediff.training.lodge import (
    check_lodge_tables,
    fit_stage,
    stage_config,
    train_lodge,
)
from dancediff.training.lodge_data import PrimitiveCut, long_enough, prepared_solos, solos_of
from dancediff.training.lodge_losses import DiscriminatorTraining, LodgeObjective
from dancediff.training.run import train_from_config
from dancediff.training.tables import read_toml
from places import CONFIGS
from tiny_lodge import GLOBAL, LOCAL, PACKAGED, TINY, tiny_lodge

GENRES = ("hiphop", "salsa")
SMALL = Layout(256, 64)


@pytest.fixture(scope="module")
def solos():
    """Smooth made-up dances: fast to make, and nothing is alike."""
    made = []
    for k, genre in enumerate(("hiphop", "salsa", "hiphop")):
        g = torch.Generator().manual_seed(k)
        t = torch.arange(300.0)[:, None] / 30
        x = 0.1 * torch.sin(t * (1 + 4 * torch.rand(139, generator=g)) + k)
        x[:, LODGE.root.start] += 0.3 * t[:, 0] + 2  # wanders off, far from the middle
        x[:, 7] += 1
        x[:, 11] += 1
        songs = torch.rand(2, 300, 35, generator=g)
        kind = "real" if k == 2 else "synthetic"
        options = {"M": songs[0], "M_other": songs[1:], "genre": genre}
        made.append(DanceTake(f"made-{k}", with_hands(x)[None], kind, **options))
    return made


def windows(solos, **options):
    change = {
        name: options.pop(name) for name in ("mirror", "music", "any_song") if name in options
    }
    frames, layout = options.pop("num_frames", 64), options.pop("layout", None)
    cut = SoloCut(frames, GENRES) if layout is None else PrimitiveCut(layout, GENRES)
    options = {"dancers_per_batch": 4, "augment": Augmentation(**change)} | options
    return WindowSampler(long_enough(solos, cut), cut, **options)


def test_windows_start_at_the_origin_and_repeat(solos):
    data = windows(solos, music=True, mirror=0.5)
    batch = x, M, genre, *_ = data.batch(3)
    assert x.shape == (4, 64, 139) and M.shape == (4, 64, 35) and genre.shape == (4,)
    assert torch.equal(x[:, 0, [4, 6]], torch.zeros(4, 2)) and x[:, 0, 5].abs().max() > 0
    assert all(torch.equal(a, b) for a, b in zip(data.batch(3)[:3], batch[:3], strict=True))
    assert not torch.equal(data.batch(4)[0], x)
    assert solos[0].x[0, 0, 4] > 1.5, "the takes themselves are left alone"


def test_windows_know_their_genre_music_and_mirror(solos):
    x, M, genre, *_ = windows(solos[1:2], mirror=1.0).batch(0)
    assert genre.tolist() == [1] * 4
    start = int((solos[1].songs[0] == M[0, 0]).all(-1).nonzero()[0, 0])
    truth = SoloCut(64, GENRES)(solos[1], start)
    assert torch.allclose(x[0], mirror_features(truth, LODGE))


def test_real_windows_have_their_share(solos):
    data = windows(solos, real=0.9)
    rng = np.random.default_rng(0)
    assert 0.8 < np.mean([data.choose(1, rng).real for _ in range(300)]) < 0.97


def test_real_dances_to_any_song(solos):
    """The song alone must not tell that somebody danced, or nothing is learned from the genre."""

    def owners(**options):
        data = windows(solos, real=0.5, dancers_per_batch=200, music=True, **options)
        x, M, *_ = data.batch(0)
        songs = [{tuple(row.tolist()) for M in solo.songs for row in M} for solo in solos]
        heard = [[tuple(m[0].tolist()) in song for song in songs].index(True) for m in M]
        danced = [
            min(range(3), key=lambda k, w=w: _nearest(solos[k], w)) for w in x[:, :, LODGE.rot6d]
        ]
        return np.array(danced), np.array(heard)

    danced, heard = owners()
    assert np.array_equal(danced, heard), "each to its own song"
    danced, heard = owners(any_song=0.5)
    assert np.array_equal(danced[danced != 2], heard[danced != 2]), (
        "the choreographer's solos keep their songs"
    )
    assert 0.3 < np.mean(heard[danced == 2] != 2) < 0.7
    assert set(heard[danced == 2]) == {0, 1, 2}


def _nearest(solo, w):
    starts = solo.x[0, : solo.num_frames - len(w) + 1, LODGE.rot6d]
    return (starts - w[0]).abs().amax(-1).min().item()


def test_primitives_are_those_of_the_clip(solos):
    x = torch.zeros(1024, 139)
    x[:, [7, 11]] = 1
    x[:, 7 + 6 * 16 + 1] = torch.sin(torch.arange(1024.0) / 9)  # an arm swings
    whole = DanceTake("long", with_hands(x)[None], M=torch.rand(1024, 35), genre="salsa")
    data = windows([whole], num_frames=1024, layout=LAYOUT)
    primitives, M, *_ = data.batch(0)
    assert primitives.shape == (4, 104, 139) and M.shape == (4, 1024, 35)
    expected, _ = primitives_of(x)
    assert torch.allclose(primitives[0].unflatten(0, (13, 8)), expected)
    thin = windows([whole], num_frames=1024, layout=Layout(stride=4)).batch(0)[0]
    assert torch.equal(thin[0], x[::4])


def test_primitives_of_a_window_are_where_the_body_rests_in_it():
    x, frames = torch.zeros(400, 139), torch.arange(400)
    x[:, LODGE.rot6d] = torch.tensor([1.0, 0, 0, 0, 1, 0]).repeat(22)
    angle = torch.cos((frames - 7) * torch.pi / 20)  # at rest in frames 7, 27, ...
    arm = LODGE.joint_channels([16])
    x[:, arm[:2]] = torch.stack([angle.cos(), angle.sin()], 1)
    x[:, arm[3:5]] = torch.stack([-angle.sin(), angle.cos()], 1)
    x[:, 0] = frames  # a contact that says which frame it is
    take = DanceTake("swings", with_hands(x)[None], M=torch.rand(400, 35), genre="salsa")
    for start in (0, 31):
        primitives = PrimitiveCut(SMALL, GENRES)(take, start).unflatten(0, (13, 8))
        middles = [m for k, m in enumerate(primitives[:, 4, 0].tolist()) if k % 3]
        assert all((m - 7) % 20 in (0, 1, 19) for m in middles), (start, middles)


def test_the_first_stage_meets_short_solos_too(solos):
    """A take of 300 frames is no 1024, but its genre must not stay unknown: it is repeated."""
    data = windows(solos[1:2], num_frames=1024, layout=LAYOUT)
    primitives, M, genre, *_ = data.batch(0)
    assert primitives.shape == (4, 104, 139) and M.shape == (4, 1024, 35)
    assert genre.tolist() == [1] * 4
    assert torch.equal(M[:, 300:], M[:, :-300]), "the music goes on from its beginning"
    steps = primitives.unflatten(1, (13, 8)).diff(dim=2).abs().amax()
    once = solos[1].x.diff(dim=1).abs().amax()
    assert steps <= once + 1e-5, "no primitive lies across the join, where the pose jumps"
    joined = data.takes[0].x[0]
    assert (joined[300] - joined[299])[7:].abs().amax() > 2 * once, "where there is a jump"
    assert torch.allclose(joined[300, [4, 6]], joined[299, [4, 6]]), "the dancer goes on from there"


def test_solos_shorter_than_a_local_segment_stay_out(solos):
    with pytest.raises(ValueError, match="local_frames=512 frames, the longest 300"):
        windows(solos, num_frames=1024, layout=Layout(1024, 512))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"num_frames": 999}, "num_frames=999 frames, the longest 300"),
        ({"mirror": 2}, "mirror=2"),
        ({"real": -1}, "real=-1"),
        ({"any_song": 1.5}, "any_song=1.5"),
        ({"dancers_per_batch": 0}, "dancers_per_batch=0"),
    ],
)
def test_bad_windows_are_named(solos, options, message):
    with pytest.raises(ValueError, match=message):
        windows(solos, **options)


def test_solos_of_takes():
    take = make_choreographed(1, 2, seconds=5.0)
    made = solos_of([take], (take.genre,))
    assert [solo.name for solo in made] == [f"{take.name}-{k}" for k in (0, 1)]
    assert torch.equal(made[1].x[0], take.motion.features()[1])
    assert solos_of([take], ("polka",)) == []


def test_a_folder_without_such_genres_is_refused(tmp_path):
    def job():
        return make_choreographed(1, 1, seconds=5.0)

    prepare([Job("choreographed_000001_1", job)], tmp_path, progress=False)
    solos = prepared_solos(tmp_path, (job().genre,))
    assert len(solos) == 1
    assert torch.allclose(solos[0].x, job().motion.features(), atol=1e-5)
    with pytest.raises(ValueError, match="genre of polka"):
        prepared_solos(tmp_path, ("polka",))


def test_takes_that_are_too_short_or_large_are_told(tmp_path):
    """Of a folder of one's own most may be; it was not said."""

    def job(dancers, seconds):
        return make_choreographed(1, dancers, seconds=seconds)

    sizes = ((1, 6.0), (2, 5.0), (3, 6.0))
    jobs = [Job(f"choreographed_000001_{n}", partial(job, n, s)) for n, s in sizes]
    prepare(jobs, tmp_path, progress=False)
    model = SimpleNamespace(num_frames=160, max_dancers=2)
    with pytest.warns(UserWarning, match=r"^of 3 .* out: 1 shorter than 160 frames, 1 of more tha"):
        assert len(prepared_takes(tmp_path, model)) == 1


def test_takes_of_other_genres_are_told():
    """One misspelt genre in a config left takes out, or their genres, without a word."""
    x, names = torch.zeros(1, 9, 151), ("Pop", "Pop", None, "Jazz")
    takes = [DanceTake(f"take {k}", x, genre=name) for k, name in enumerate(names)]
    tell_other_genres(takes, ["Jazz", "Pop", None], "left out")
    with pytest.warns(UserWarning, match=r"^3 of 4 takes are left out, .*: Pop \(2\), none told"):
        tell_other_genres(takes, ["Jazz"], "left out")


def test_statistics_fit_what_the_stage_sees(solos):
    data = windows(solos, mirror=0.5)
    model = tiny().local_stage
    fit_stage(model, data)
    for number in range(5):
        x = model.normalizer.normalize(data.batch(number)[0])
        assert x.abs().max() < 1.3
    assert model.normalizer.low[4] < 0 < model.normalizer.high[4] < 1, "root from the origin"
    assert preconditioning_of(model).std.std() > 0.01
    far = windows([replace(solos[0], dance=9 * solos[0].x)])
    fit_stage(model, far, TrainingExtensions(metre_unit=True))
    on_floor = [LODGE.root.start, LODGE.root.start + 2]
    assert model.normalizer.scale[on_floor].max() <= FLOOR_UNIT, "no unit is as wide as the stage"
    assert model.normalizer.normalize(far.batch(0)[0])[..., on_floor].max() > 3
    fit_stage(model, data, TrainingExtensions(masked_music=("chroma",)))
    assert model.music_normalizer.normalize(solos[0].songs[0])[:, CHROMA].abs().max() < 1e-4
    coarse = tiny().global_stage
    fit_stage(coarse, windows(solos, num_frames=256, layout=SMALL))
    assert preconditioning_of(coarse).std.shape == (8, 139)


def test_fine_tuning_sees_clean_borders(solos):
    model = tiny().local_stage
    config = TrainConfig(weights=LodgeWeights.fine_tune())
    batch, seen = windows(solos).batch(0), []

    model.register_forward_pre_hook(lambda _, args: seen.append(args[0]))
    for border in (0, 4):
        LodgeObjective(model, config, border=border).losses(model, batch, 0)
    x_0 = model.normalizer.normalize(batch[0])
    noisy, mixed = seen
    assert torch.equal(mixed[:, :4, 7:], x_0[:, :4, 7:])
    assert torch.equal(mixed[:, -4:, :4], x_0[:, -4:, :4])
    assert torch.equal(mixed[:, 4:-4], noisy[:, 4:-4])
    assert torch.equal(mixed[:, :, LODGE.root], noisy[:, :, LODGE.root])
    assert not torch.allclose(noisy[:, :4, 7:], x_0[:, :4, 7:], atol=0.1)


def test_levels_count_as_often_as_they_are_drawn_too_rarely(solos):
    """Both stages: a row's weight makes up for the odds of its level."""
    model = tiny().local_stage
    data, even = windows(solos), TrainConfig(weights=LodgeWeights.local())
    fit_stage(model, data)
    levels = level_weights(preconditioning_of(model).error(model.abar), 0.5)
    seen = []

    def forward(x_t, t, conditions):
        seen.append(t)
        x = torch.zeros_like(x_t)
        return x, x

    model.forward = forward
    x, M, genre, *_ = data.batch(0)
    batch = x[:1], M[:1], genre[:1]
    one, plain = (
        LodgeObjective(model, replace(even, extensions=extensions)).losses(model, batch, 0)
        for extensions in (TrainingExtensions(level_weights=0.5), TrainingExtensions())
    )
    weight = levels[seen[0]].sqrt() * levels.sqrt().mean()
    assert one["recon"].item() == pytest.approx((weight * plain["recon"]).item(), rel=1e-4)


def tiny():
    return tiny_lodge(second={"genres": GENRES})


def critic(**options):
    torch.manual_seed(0)
    sizes = DiscriminatorConfig(**TINY, num_frames=20, genres=GENRES)
    return DiscriminatorTraining(sizes, lr=1e-2, **options)


def test_the_discriminator_learns_every_second_time_and_only_from_its_own_loss():
    c, g = critic(), torch.Generator().manual_seed(0)
    x_0, M = torch.zeros(4, 20, 139), torch.rand(4, 20, 35)
    x_hat = torch.ones(4, 20, 139, requires_grad=True)
    genre = torch.tensor([0, 1, 0, 1])
    before = [p.clone() for p in c.D.parameters()]
    terms = c.terms(x_hat, x_0, M, genre, 0, g)
    assert set(terms) == {"critic", "genre", "focus"}
    (terms["genre"] + terms["focus"]).backward()
    assert x_hat.grad.abs().max() > 0 and all(p.grad is None for p in c.D.parameters())
    assert all(torch.equal(a, b) for a, b in zip(before, c.D.parameters(), strict=True))
    for number in range(1, 60):
        held = [p.clone() for p in c.D.parameters()]
        terms = c.terms(x_hat, x_0, M, genre, number, g)
        same = all(torch.equal(a, b) for a, b in zip(held, c.D.parameters(), strict=True))
        assert same == (number % 2 == 0) and not terms["critic"].requires_grad
    assert terms["critic"] < 0.5, "black from white must be told apart; it starts near 1"
    with torch.no_grad():
        assert (c.D(x_0, M, genre) > c.D(x_hat, M, genre)).all(), "true dances are the real ones"


def test_focus_compares_with_another_genre():
    c = critic()
    c.D.logits = lambda x, M: torch.tensor([[1.0, 9.0]]).expand(len(x), 2)
    x, g = torch.zeros(3, 20, 139), torch.Generator().manual_seed(0)
    for genre, focus in ((0, 0.5 * (9 - 1)), (1, 0.5 * (1 - 9))):
        terms = c.terms(x, x, torch.zeros(3, 20, 35), torch.full((3,), genre), 0, g)
        assert terms["focus"].item() == focus


def test_the_generator_gains_by_what_the_discriminator_calls_real(solos):
    """Eq. 9 enters the total with its weight; a better verdict makes it smaller."""
    model = tiny().local_stage
    config, batch, totals = TrainConfig(weights=LodgeWeights.local()), windows(solos).batch(0), {}

    class Verdict:
        def __init__(self, made):
            self.made = made

        def terms(self, *batch):
            return {"genre": l_genre(torch.tensor([self.made]))}

    for made in (0.0, 3.0):
        objective = LodgeObjective(model.train(), config, discriminator=Verdict(made))
        totals[made] = objective.losses(model, batch, 0)["total"].item()
    assert totals[3.0] - totals[0.0] == pytest.approx(-3.0 * config.weights.genre, rel=1e-2)


TABLES = {
    "data": {"windows_per_batch": 2, "mirror": 0.5},
    "model": {"class": "Lodge", "extensions": list(PACKAGED)},
    "global_stage": GLOBAL,
    "local_stage": LOCAL | {"genres": list(GENRES)},
    "train": {"steps": 2, "warmup": 1},
    "train_fine_tune": {"steps": 3},
}


def logged(folder):
    return list(csv.DictReader((folder / "losses.csv").read_text().splitlines()))


def test_all_stages_are_trained_and_make_one_model(solos, tmp_path):
    seen = []
    tables = TABLES | {"discriminator": TINY, "train_local": {"preview_every": 2}}
    model = train_lodge(
        tables, tmp_path, solos=solos, preview=lambda made, step: seen.append((type(made), step))
    )
    assert isinstance(model, Lodge) and not model.training and seen == [(Lodge, 2)]
    assert [len(logged(tmp_path / k)) for k in ("global", "local", "fine_tune")] == [2, 2, 3]
    assert {"recon", "joint", "foot", "genre", "focus", "diversity"} <= set(
        logged(tmp_path / "local")[0]
    )
    assert "genre" not in logged(tmp_path / "global")[0]
    for stage in ("local", "fine_tune"):
        kept = load_extra(tmp_path / stage / "checkpoint.safetensors")
        assert {name.split(".")[0] for name in kept} == {"weights", "moments"}
    assert load_extra(tmp_path / "global" / "checkpoint.safetensors") == {}
    hub.save_model(model, tmp_path / "model", card="tiny", dtype=torch.float32)
    again = hub.load(tmp_path / "model").model
    for name, value in model.state_dict().items():
        assert torch.equal(again.state_dict()[name], value), name


def test_a_finished_run_is_not_done_again(solos, tmp_path, capsys):
    first = train_lodge(TABLES, tmp_path, solos=solos)
    assert "training local: " in capsys.readouterr().err
    again = train_lodge(TABLES, tmp_path, solos=solos, resume=True)
    for name, value in first.state_dict().items():
        assert torch.equal(again.state_dict()[name], value), name
    assert len(logged(tmp_path / "local")) == 2
    other = TABLES | {"data": TABLES["data"] | {"mirror": 0.25}}
    with pytest.warns(UserWarning, match="in a training on other data"):
        train_lodge(other, tmp_path, solos=solos, resume=True)


def test_what_is_fitted_goes_to_the_device_too(solos, tmp_path):
    """Scales stayed on the CPU, and batches follow the scales; "meta" stands for a GPU."""
    tables = check_lodge_tables(TABLES, "here")
    training = lodge_training.LodgeTraining(tables, tmp_path, device="meta")
    training.learn_from(solos, None)
    for stage in (training.model.global_stage, training.model.local_stage):
        kinds = {x.device.type for x in (*stage.parameters(), *stage.buffers())}
        assert kinds == {"meta"}
        objective = LodgeObjective(stage, TrainConfig(weights=LodgeWeights.local()))
        assert objective.device.type == "meta"


def same(a, b):
    a, b = a.state_dict(), b.state_dict()
    return a.keys() == b.keys() and all(torch.equal(a[name], b[name]) for name in a)


def test_more_steps_before_fine_tuning_are_fine_tuned_anew(solos, tmp_path):
    """The old fine-tuned network was taken instead, and the new steps were thrown away."""
    tables = TABLES | {"train": TABLES["train"] | {"decay": 0.0}}
    train_lodge(tables, tmp_path / "parts", solos=solos)
    more = tables | {"train_local": {"steps": 3}}
    whole = train_lodge(more, tmp_path / "whole", solos=solos)
    with pytest.warns(UserWarning, match=r"what is in \S+fine_tune is trained anew"):
        parts = train_lodge(more, tmp_path / "parts", solos=solos, resume=True)
    assert same(parts, whole)
    more |= {"train_global": {"steps": 3}}  # another network, so no warning: the rest stays
    train_lodge(more, tmp_path / "parts", solos=solos, resume=True)
    assert len(logged(tmp_path / "parts" / "global")) == 3


def test_an_overwritten_training_that_was_stopped_goes_on_as_the_new_one(solos, tmp_path):
    """Stopped in its first stage, it went on with the old other ones."""
    new = TABLES | {"train": TABLES["train"] | {"seed": 1}}
    whole = train_lodge(new, tmp_path / "whole", solos=solos)
    train_lodge(TABLES, tmp_path / "parts", solos=solos)

    class Stopped(lodge_training.LodgeObjective):
        def losses(self, model, batch, number):
            if number == 1:
                raise KeyboardInterrupt
            return super().losses(model, batch, number)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lodge_training, "LodgeObjective", Stopped)
        often = new | {"train_global": {"save_every": 1}}
        with pytest.raises(KeyboardInterrupt):
            train_lodge(often, tmp_path / "parts", solos=solos, overwrite=True)
    assert same(train_lodge(new, tmp_path / "parts", solos=solos, resume=True), whole)


def test_solos_that_are_too_short_to_evaluate_on_do_not_stop_a_training(
    solos, tmp_path, monkeypatch
):
    short = replace(solos[0], dance=solos[0].x[:, :50], M=solos[0].M[:50], M_other=None)
    monkeypatch.setattr(lodge_training, "choreographed_solos", lambda *_, **__: [short])
    tables = TABLES | {"train": TABLES["train"] | {"evaluate_every": 1}}
    with pytest.warns(UserWarning) as told:
        train_lodge(tables, tmp_path, solos=solos)
    said = [str(one.message) for one in told]
    assert [text.split(":")[0] for text in said] == [
        f"the {stage} stage has no validation" for stage in ("global", "local")
    ]
    assert all("64 frames, the longest 50" in text for text in said)
    assert "validation" not in logged(tmp_path / "local")[0]


def test_genres_that_the_choreographer_does_not_dance_are_named():
    """Before, the message was that no solo is long enough."""
    with pytest.raises(ValueError, match=r"dances none of the genres Breaking, .*\(--data\)"):
        lodge_training.solos_for(SoloData(), None, FINEDANCE)
    with pytest.raises(ValueError, match=r"none of the choreographer's 1 solos .* genres kpop;"):
        lodge_training.solos_for(SoloData(songs=1, seconds=5.0, varied=False), None, ("kpop",))


def test_a_stopped_run_goes_on_bit_by_bit_with_its_discriminator(solos, tmp_path):
    """Weights and moments of both networks; the discriminator's were lost before."""
    steps = {"steps": 4, "preview_every": 2, "save_every": 2}
    tables = TABLES | {"discriminator": TINY, "train_local": steps}
    tables |= {"train_global": {"steps": 0}, "train_fine_tune": {"steps": 0}}

    def stop(made, step):
        raise KeyboardInterrupt

    train_lodge(tables, tmp_path / "whole", solos=solos)
    with pytest.raises(KeyboardInterrupt):
        train_lodge(tables, tmp_path / "parts", solos=solos, preview=stop)
    train_lodge(tables, tmp_path / "parts", solos=solos, resume=True)
    whole, parts = (
        load_file(tmp_path / k / "local" / "checkpoint.safetensors") for k in ("whole", "parts")
    )
    assert whole.keys() == parts.keys() and any(name.startswith("extra.moments") for name in whole)
    for name, value in whole.items():
        assert torch.equal(value, parts[name]), name
    other = tables | {"discriminator": TINY | {"d_model": 32}}
    with pytest.raises(ValueError, match="no discriminator of this config"):
        train_lodge(other, tmp_path / "parts", solos=solos, resume=True)


def test_level_weights_muon_and_bf16(solos, tmp_path):
    tables = TABLES | {
        "train": {"steps": 1, "optimizer": "muon", "precision": "bf16"},
        "extensions": {"level_weights": 0.5},
    }
    model = train_lodge(tables | {"train_fine_tune": {"steps": 0}}, tmp_path, solos=solos)
    assert all(p.isfinite().all() for p in model.parameters())
    assert not (tmp_path / "fine_tune").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"moodel": {}}, "no table 'moodel'"),
        ({"local_stage": {"colour": 1}}, "'local_stage' has no 'colour'"),
        ({"train_local": {"weights": 1}}, "'weights'"),
        ({"train_local": {"metrics_every": 5}}, "metrics_every=5 is for models of one stage"),
        ({"weights_local": {"dist": 1}}, "'dist'"),
        ({"train_local": {"seed": 7}}, "'train_local': seed is that of 'train'"),
        ({"weights_local": {"form": "hing"}}, "form='hing' is not one of 'hinge', 'log'"),
        ({"discriminator": {"heads": 1}}, "'heads'"),
        ({"discriminator": {"num_heads": 3}}, "d_model=512 must be a multiple of num_heads=3"),
        ({"discriminator": {"num_frames": 99}}, "num_frames is that of 'local_stage'"),
        ({"discriminator": {"genres": ["jazz"]}}, "genres is that of 'local_stage'"),
    ],
)
def test_config_mistakes_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        check_lodge_tables(TABLES | change, "here")


def test_stages_inherit_and_override():
    tables = check_lodge_tables(TABLES | {"weights_local": {"jacc": 0.5}}, "here")
    assert stage_config(tables, "global").weights == LodgeWeights.coarse()
    assert stage_config(tables, "local").weights == LodgeWeights.local(jacc=0.5)
    fine = stage_config(tables, "fine_tune")
    assert fine.steps == 3 and fine.warmup == 1 and fine.weights == LodgeWeights.fine_tune()


def test_packaged_config_is_valid():
    raw = read_toml(CONFIGS / "lodge_small.toml")
    tables = check_lodge_tables(raw, "lodge_small")
    assert GlobalConfig(**tables["global_stage"]).music_frames == 1024
    for stage in ("global", "local", "fine_tune"):
        config = stage_config(tables, stage)
        assert config.steps > 0


def test_the_class_in_the_file_decides(solos, tmp_path):
    lines = ['[model]\nclass = "Lodge"\n[train]\nsteps = 1\n']
    for stage in ("global_stage", "local_stage"):
        entries = (f"{k} = {v!r}" for k, v in TABLES[stage].items())
        lines.append(f"[{stage}]\n" + "\n".join(entries) + "\n")
    path = tmp_path / "c.toml"
    path.write_text("".join(lines))
    model = train_from_config(path, tmp_path / "run", takes=solos)
    assert isinstance(model, Lodge)
    assert model.abar.equal(cosine_abar(1000))


def test_a_new_run_forgets_old_previews(solos, tmp_path):
    tables = TABLES | {f"train_{stage}": {"steps": 0} for stage in ("global", "fine_tune")}
    old = tmp_path / "previews" / "step_000002.png"
    old.parent.mkdir()
    old.touch()
    train_lodge(tables, tmp_path, solos=solos)
    assert old.exists()  # of another stage, perhaps
    train_lodge(tables, tmp_path, solos=solos, overwrite=True)
    assert not old.exists()


def test_stages_can_be_trained_one_at_a_time(solos, tmp_path):
    whole = train_lodge(TABLES, tmp_path / "whole", solos=solos)
    others = {"global": {"local", "fine_tune"}, "local": {"global", "fine_tune"}}
    for stage in ("global", "local", "fine_tune"):
        off = others.get(stage, {"global", "local"})
        tables = TABLES | {f"train_{name}": {"steps": 0} for name in off}
        model = train_lodge(tables, tmp_path / "parts", solos=solos)
    for name, value in whole.state_dict().items():
        assert torch.equal(model.state_dict()[name], value), name
    (tmp_path / "parts" / "global" / "checkpoint.safetensors").write_bytes(b"damaged")
    with pytest.raises(ValueError, match=r"checkpoint\.safetensors is no checkpoint"):
        train_lodge(tables, tmp_path / "parts", solos=solos, overwrite=True)


def test_fine_tuning_alone_has_clean_borders(solos, tmp_path):
    """Eq. 10 is the input of the last training and of no other."""
    given = {}

    class Watched(lodge_training.LodgeObjective):
        def losses(self, model, batch, number):
            given[self.border] = True
            return super().losses(model, batch, number)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lodge_training, "LodgeObjective", Watched)
        for stage, border in (("global", 0), ("local", 0), ("fine_tune", 3)):
            off = {f"train_{k}": {"steps": 0} for k in ("global", "local", "fine_tune")}
            tables = TABLES | off | {f"train_{stage}": {"steps": 1}}
            tables["global_stage"] = GLOBAL | {"primitive_frames": 6}  # of which each half is 3
            train_lodge(tables, tmp_path / stage, solos=solos)
            assert given == {border: True}, stage
            given.clear()


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"model": {"extensions": ["wings"]}}, "'model'.*'wings' is not one of"),
        ({"model": {"extensions": ["non_local_filter"]}}, "needs 'preconditioning'"),
        ({"local_stage": {"beat_waves": True}}, "'local_stage' has no 'beat_waves'"),
    ],
)
def test_what_a_model_cannot_have_is_named(table, message):
    with pytest.raises(ValueError, match=message):
        check_lodge_tables(TABLES | table, "here")


def test_primitives_of_a_window_are_those_with_most_movement_in_it():
    """A dance that is small at first and large later, and the other way round."""
    frames = torch.arange(400)
    size = torch.where((frames // 45) % 2 == 0, 0.2, 1.0)  # of a swing; rests lie 15 frames apart
    angle = size * torch.cos(frames * torch.pi / 15)
    x = torch.zeros(400, 139)
    x[:, LODGE.rot6d] = torch.tensor([1.0, 0, 0, 0, 1, 0]).repeat(22)
    arm = LODGE.joint_channels([16])
    x[:, arm[:2]] = torch.stack([angle.cos(), angle.sin()], 1)
    x[:, arm[3:5]] = torch.stack([-angle.sin(), angle.cos()], 1)
    x[:, 0] = frames  # a contact that says which frame it is
    take = DanceTake("swings", with_hands(x)[None], M=torch.rand(400, 35), genre="salsa")
    layout = Layout(256, 128)
    for start in (0, 45, 60):
        cut = PrimitiveCut(layout, GENRES)(take, start).unflatten(0, (layout.num_primitives, 8))
        middles = [round(m) for k, m in enumerate(cut[:, 4, 0].tolist()) if k % 3]
        energy = take.kinematic_energy
        for k, middle in enumerate(middles):
            low = start + 64 * k
            rests = [b for b in take.motion_beats if low + 12 <= b < low + 52]
            assert energy[middle] >= max(energy[b] for b in rests) - 1e-9, (start, middle)
