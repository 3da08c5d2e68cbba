"""Songs of hours: memory stays bounded, time grows with the length, and no faster."""

import os
import subprocess
import sys

import pytest
import soundfile

from dancediff.music.synth import synth_song

LONG = os.environ.get("DANCEDIFF_TRUST") == "long"
MINUTES = (20, 120) if LONG else (2, 4)
LIMIT = 2048  # MiB
pytestmark = [pytest.mark.slow, pytest.mark.timeout(3000)]


@pytest.fixture(scope="module")
def songs(tmp_path_factory):
    """Synthetic songs, the same minute again and again, in stereo at 44,100 Hz."""
    audio = synth_song(1, seconds=120)[0].audio.repeat(2, axis=1)
    files = {}
    for minutes in MINUTES:
        files[minutes] = tmp_path_factory.mktemp("songs") / f"{minutes}.flac"
        with soundfile.SoundFile(files[minutes], "w", 44100, 2) as file:
            for _ in range(minutes):
                file.write(audio[: 60 * 44100])
    return files


def danced(song, out, *words) -> tuple[float, float]:
    """CPU seconds, and the most memory in MiB, of a process that dances to a file."""
    command = [sys.executable, "-m", "dancediff.cli", "generate", str(song), "--steps", "1"]
    process = subprocess.Popen(
        [*command, "--formats", "npz", "--json", "--out", str(out), *words],
        stdout=subprocess.DEVNULL,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


@pytest.mark.skipif(not hasattr(os, "wait4"), reason="asks a POSIX system how much was needed")
@pytest.mark.parametrize("words", [("--dancers", "1"), ("--model", "lodge")])
def test_hours_fit_into_memory(songs, tmp_path, words, record_property):
    model = "lodge" if "lodge" in words else "tcdiffpp"
    took, memory = {}, {}
    for minutes, song in songs.items():
        took[minutes], memory[minutes] = danced(song, tmp_path / str(minutes), *words)
        assert (tmp_path / str(minutes) / "dance.npz").stat().st_size > minutes * 1800 * 604
        record_property(
            "trust",
            f"{minutes} minutes with {model}, 1 step: {took[minutes]:.0f} s of CPU time, at most "
            f"{memory[minutes]:.0f} MiB",
        )
        assert memory[minutes] < LIMIT
    few, many = MINUTES
    assert took[many] < 1.3 * many / few * took[few]
    assert memory[many] - memory[few] < 60 * (many - few)  # MiB; sound takes about 20 a minute
