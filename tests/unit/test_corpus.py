import pytest
import torch

from dancediff.data import corpus as module
from dancediff.data.corpus import choreographed_corpus, choreographed_takes
from dancediff.data.windows import Take


def same(a, b):
    return all(
        (p.name, p.song) == (q.name, q.song) and torch.equal(p.x, q.x) and torch.equal(p.M, q.M)
        for p, q in zip(a, b, strict=True)
    )


def test_cache_gives_the_same_takes_and_makes_only_what_is_missing(tmp_path, monkeypatch):
    plain = choreographed_corpus([4, 2], seconds=6.0, workers=1)
    assert [t.num_dancers for t in plain] == 2 * [1, 2, 3, 4, 5]
    assert same(plain[:5], choreographed_takes(4, seconds=6.0))
    assert same(plain, choreographed_corpus([4, 2], seconds=6.0, workers=1, cache=tmp_path))

    made, make = [], choreographed_takes

    def counted(seed, **options):
        made.append(seed)
        return make(seed, **options)

    monkeypatch.setattr(module, "choreographed_takes", counted)
    again = choreographed_corpus([4, 2, 7], seconds=6.0, workers=1, cache=tmp_path)
    assert same(plain, again[:10])
    assert made == [4, 7]  # one is made again to see that the cache is of this choreographer


def test_cache_survives_a_kill_between_two_files(tmp_path):
    whole = choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)
    expected = [t.M.clone() for t in whole]
    (tmp_path / "synth-1.M.npy").unlink()
    (tmp_path / ".part.99.synth-1.M.npy").write_bytes(b"half a file")
    again = choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)
    assert all(torch.equal(t.M, M) for t, M in zip(again, expected, strict=True))


def test_cache_of_another_choreographer_is_refused(tmp_path, monkeypatch):
    choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)
    with pytest.raises(ValueError, match="other seconds than 7"):
        choreographed_corpus([1], seconds=7.0, workers=1, cache=tmp_path)
    make = choreographed_takes

    def changed(seed, **options):
        return [Take(t.name, t.x + 0.01, t.M, t.song) for t in make(seed, **options)]

    monkeypatch.setattr(module, "choreographed_takes", changed)
    with pytest.raises(ValueError, match="another version of the choreographer"):
        choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)


def test_damaged_cache_file_is_named(tmp_path):
    choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)
    path = tmp_path / "synth-1.x.npy"
    for data in (path.read_bytes()[:-100], b"nonsense", b""):
        path.unlink()
        path.write_bytes(data)
        with pytest.raises(ValueError, match=r"synth-1\.x\.npy.*is damaged"):
            choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)


def test_changing_a_mapped_take_does_not_change_the_file(tmp_path):
    take = choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)[0]
    take.x.add_(1.0)
    again = choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)[0]
    assert torch.allclose(again.x, take.x - 1.0, atol=1e-5)


@pytest.mark.slow
def test_several_processes_make_the_same_corpus(tmp_path):
    one = choreographed_corpus([0, 1], seconds=6.0, workers=1)
    two = choreographed_corpus([0, 1], seconds=6.0, workers=2, cache=tmp_path)
    for a, b in zip(one, two, strict=True):
        assert a.name == b.name
        torch.testing.assert_close(a.x, b.x, rtol=1e-4, atol=1e-4)
        torch.testing.assert_close(a.M, b.M, rtol=1e-4, atol=1e-3)
