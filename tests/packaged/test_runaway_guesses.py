"""Guesses of the packaged model stay within what frequencies the genre has in training."""

import dancediff as dd
from dancediff.extensions.formation_prior import FormationPrior
from dancediff.extensions.frequency_clip import room_for_places
from dancediff.extensions.parts import part_of
from dancediff.extensions.preconditioning import dct_matrix
from dancediff.generation.segmented_dance import spectrum_asked


def test_no_guess_runs_away():
    """Pushed ten times as far, a dance stays within what frequencies its genre has in training."""
    model, song = dd.load("tcdiffpp"), dd.packaged_song()
    free = dict.fromkeys(("foot_contact", "collision_avoidance", "order_constraint"), False)
    ask = {"dancers": 2, "seconds": 5, "steps": 8} | free
    spectrum = spectrum_asked(model.model, model.resolve(song, **ask))
    C, formation = dct_matrix(150), part_of(model.model, FormationPrior)
    room = room_for_places(formation, 2, 151)
    largest = {}
    for kind, w in (("usual", 1.0), ("pushed", 10.0)):
        guesses = []
        look = lambda done, total, guess, seen=guesses: seen.append(guess)  # noqa: E731
        model.generate(song, autoguidance=w, watch=look, **ask)
        x = model.model.normalizer.normalize(guesses[-1].features())
        further = (C @ (x - spectrum.mean)).abs() - room  # than a dancer is expected
        largest[kind] = (further / spectrum.std)[..., 4:7].max()
    assert largest["pushed"] < 4.05  # the dance went through rotations and back
    assert largest["usual"] < 4.05
