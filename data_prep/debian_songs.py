"""Freely licensed songs of Debian's packages -> one folder for `dancediff prepare songs`.

    python data_prep/debian_songs.py OUT [--debs FOLDER] [--exclude FOLDER ...]

Packages are fetched with apt-get download and unpacked with dpkg-deb; nothing is installed. MIDI
tunes are rendered with each sound font, which needs `apt-get install portaudio19-dev`, then
`pip install mido tinysoundfont`; without them they are left out. OUT/songs.toml tells title,
author, licence and package of every song. Songs that are also in an --exclude folder (by name,
title or bytes) stay out: those that models are tested on.
"""

import argparse
import fnmatch
import json
import re
import shutil
import subprocess
import tempfile
import zipfile
from collections import defaultdict
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
import soundfile

from dancediff.atomic import atomic_write, write_text
from dancediff.data.song_folder import MANIFEST, SongFile
from dancediff.music.song import Music
from dancediff.music.sound_on_disk import SOUND_SUFFIXES

SHORTEST_TUNE = 20.0  # seconds; shorter files are jingles and sounds of games
LONGEST = 240.0  # seconds of a tune that are rendered
RATE = 32000  # of rendered tunes


@dataclass(frozen=True)
class Package:
    """Where a package has its songs; author and licence if its copyright file is free text."""

    name: str
    songs: str  # below usr/share
    author: str = ""
    licence: str = ""


PACKAGES = (
    Package("asc-music", "games/asc/music/*.mp3"),
    Package("fretsonfire-songs-muldjord", "games/fretsonfire/data/songs/muldjord/*/song.ogg",
            "El Senator (Muldjord)", "CC-BY-SA-3.0"),
    Package("fretsonfire-songs-sectoid", "games/fretsonfire/data/songs/sectoid/*/song.ogg",
            "Carlos Viola Iborra", "MIT"),
    Package("hyperrogue-music", "hyperrogue/music/*.ogg"),
    Package("nexuiz-music", "games/nexuiz/data/music.pk3", "Nexuiz team (Alientrap)", "GPL-2+"),
    Package("openttd-openmsx", "games/openttd/baseset/openmsx/*.mid"),
    Package("planetblupi-music-ogg", "planetblupi/music/*.ogg"),
    Package("pushover-data", "pushover/themes/*.ogg", "Roberto Lorenz"),
    Package("singularity-music", "games/singularity/music/**/*.ogg", "Max McCracken",
            "CC-BY-SA-3.0"),
    Package("supertux-data", "games/supertux2/music/**/*.ogg"),
    Package("ufoai-music", "games/ufoai/base/0music.pk3"),
    Package("warzone2100-music", "games/warzone2100/music/**/*.opus"),
    Package("wesnoth-1.16-music", "games/wesnoth/1.16/data/core/music/*.ogg", "Wesnoth team",
            "GPL-2+"),
)  # fmt: skip
FONTS = {  # package: file, licence
    "timgm6mb-soundfont": ("TimGM6mb.sf2", "GPL-2"),
    "fluid-soundfont-gm": ("FluidR3_GM.sf2", "MIT"),
    "opl3-soundfont": ("OPL-3_FM_128M.sf2", "CC-BY-SA-4.0"),
}


def unpacked(name: str, debs: Path, into: Path) -> Path:
    """The files of a package, fetched if the folder ``debs`` lacks it; returns its usr/share."""
    debs.mkdir(parents=True, exist_ok=True)
    if not list(debs.glob(f"{name}_*.deb")):
        subprocess.run(["apt-get", "download", name], cwd=debs, check=True)
    deb = sorted(debs.glob(f"{name}_*.deb"))[-1]
    subprocess.run(["dpkg-deb", "-x", deb, into / name], check=True)
    share = into / name / "usr" / "share"
    for archive in share.rglob("*.pk3"):  # a zip file
        zipfile.ZipFile(archive).extractall(archive.with_suffix(".files"))
    return share


def stanzas(text: str) -> list[tuple[list[str], str, str]]:
    """(patterns, author, licence) of a machine-readable copyright file; later ones win.

    >>> stanzas("Files: a/*\\n b.ogg\\nCopyright: 2009 A. B. <x@y>\\nLicense: CC0-1.0\\n")
    [(['a/*', 'b.ogg'], 'A. B.', 'CC0-1.0')]
    """
    found = []
    for block in re.split(r"\n\s*\n", text):
        fields = dict(re.findall(r"^(Files|Copyright|License):((?:.*\n?)(?:[ \t]+.*\n?)*)", block,
                                 flags=re.MULTILINE))  # fmt: skip
        if set(fields) == {"Files", "Copyright", "License"}:
            names = [re.sub(r"<.*?>|\(c\)|©|[\d,-]{4,}", " ", line, flags=re.IGNORECASE)
                     for line in fields["Copyright"].splitlines()]  # fmt: skip
            author = ", ".join(" ".join(line.split()).strip(" ,") for line in names if line.strip())
            licence = fields["License"].strip().splitlines()[0]
            found.append((fields["Files"].split(), author, licence))
    return found


def named(pattern: str, path: Path) -> bool:
    """Does a pattern of a copyright file mean this file? Folders above may be called otherwise.

    >>> named("data/music/*", Path("games/supertux2/music/misc/theme.ogg"))
    True
    >>> named("debian/*", Path("games/supertux2/music/misc/theme.ogg"))
    False
    """
    parts, folders = pattern.split("/"), path.parts
    ends = {"/".join(parts[k:]) for k in range(max(1, len(parts) - 1))}
    names = ["/".join(folders[k:]) for k in range(len(folders))]
    return any(fnmatch.fnmatchcase(name, end) for name in names for end in ends)


def origin(package: Package, path: Path, share: Path) -> tuple[str, str]:
    """Author and licence of a song: of the package, or of the last stanza that names the file."""
    author, licence = "", ""
    text = (share / "doc" / package.name / "copyright").read_text(encoding="utf-8")
    for patterns, who, what in stanzas(text):
        if any(named(pattern, path) for pattern in patterns):
            author, licence = who, what
    return package.author or author or "unknown", package.licence or licence or "unknown"


def files_of(package: Package, share: Path) -> list[Path]:
    """Songs and tunes of a package, those in archives too."""
    paths = []
    for path in sorted(share.glob(package.songs)):
        inside = path.with_suffix(".files")
        paths += sorted(inside.rglob("*.ogg")) if inside.is_dir() else [path]
    return paths


def whole(path: Path) -> Music:
    """A song; those of Frets on Fire are a band and a guitar that are played together."""
    music, guitar = Music.load(path), path.with_name("guitar.ogg")
    if not guitar.exists():
        return music
    other = Music.load(guitar)
    n = min(len(music.audio), len(other.audio))
    return Music(0.5 * (music.audio[:n] + other.audio[:n]), music.rate, path.parent.name)


def rendered(path: Path, font: Path) -> Music:
    """A MIDI tune, played by a sound font."""
    import mido
    import tinysoundfont

    synth = tinysoundfont.Synth(samplerate=RATE)
    synth.sfload(str(font))
    tinysoundfont.Sequencer(synth).midi_load(str(path))
    blocks = int(min(mido.MidiFile(path).length + 2, LONGEST) * RATE) // 512
    y = np.concatenate([np.frombuffer(bytes(synth.generate(512)), np.float32)
                        for _ in range(blocks)])  # fmt: skip
    return Music(0.9 * y.reshape(-1, 2) / max(1.0, float(np.abs(y).max())), RATE, path.stem)


def known(folders: list[Path]) -> set[str]:
    """Titles and hashes of the songs in some folders.

    Raises: ValueError naming a folder that is not there: its songs would not stay out.
    """
    for folder in folders:
        if not folder.is_dir():
            raise ValueError(f"--exclude {str(folder)!r} is no folder; name one that is there")
    found = [p for folder in folders for p in folder.rglob("*")]
    paths = [p for p in found if p.suffix.lower() in SOUND_SUFFIXES]
    keys = {SongFile(path, path.stem).key for path in paths}
    return keys | {sha256(path.read_bytes()).hexdigest() for path in paths}


def collect(package: Package, out: Path, share: Path, fonts: dict[str, Path], never: set[str]):
    """Copy or render a package's songs; yields what the manifest says of each, and its seconds."""
    for path in files_of(package, share):
        title = path.parent.name if path.name == "song.ogg" else path.stem
        author, licence = origin(package, path, share)
        if SongFile(path, title).key in never or sha256(path.read_bytes()).hexdigest() in never:
            print(f"left out, because models are tested on it: {title}")
            continue
        versions = fonts if path.suffix == ".mid" else {"": path}
        for font, source in versions.items():
            name = f"{title}--{font}" if font else title
            target = out / package.name / f"{name}{'.mp3' if path.suffix == '.mp3' else '.ogg'}"
            if not target.exists():
                target.parent.mkdir(parents=True, exist_ok=True)
                if font:
                    rendered(path, source).save(target)
                elif path.with_name("guitar.ogg").exists():
                    whole(path).save(target)
                else:
                    with atomic_write(target) as part:  # a stopped copy would count as whole
                        shutil.copyfile(path, part)  # opus is ogg by another suffix
            seconds = soundfile.info(target).duration
            if seconds < SHORTEST_TUNE:
                target.unlink()
                continue
            facts = {
                "file": target.relative_to(out).as_posix(),
                "title": f"{title} ({package.name})",
            }
            facts |= {"author": author, "licence": licence, "package": package.name}
            if font:
                facts["licence"] = f"{licence}; sound font {font}: {FONTS[font][1]}"
            yield facts, seconds


def main() -> None:
    """Read the arguments, collect all packages, and write the manifest."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="folder for the songs")
    parser.add_argument("--debs", type=Path, help="folder with packages; default: OUT/debs")
    parser.add_argument("--exclude", type=Path, nargs="*", default=[], help="songs to leave out")
    args = parser.parse_args()
    debs, never, rows = args.debs or args.out / "debs", known(args.exclude), []
    total: dict[str, list[float]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as scratch:
        fonts = {}
        try:
            import mido  # noqa: F401
            import tinysoundfont  # noqa: F401

            for name, (file, _) in FONTS.items():
                fonts[name] = unpacked(name, debs, Path(scratch)) / "sounds" / "sf2" / file
        except ImportError as err:
            print(f"MIDI tunes are left out: {err}; see the top of this file")
        for package in PACKAGES:
            share = unpacked(package.name, debs, Path(scratch))
            for facts, seconds in collect(package, args.out, share, fonts, never):
                rows.append(facts)
                total[package.name].append(seconds)
            shutil.rmtree(Path(scratch) / package.name)
    tables = ("\n".join(f"{k} = {json.dumps(v, ensure_ascii=False)}" for k, v in row.items())
              for row in rows)  # fmt: skip
    text = "".join(f"[[song]]\n{table}\n\n" for table in tables)
    write_text(args.out / MANIFEST, text)
    for name, each in total.items():
        print(f"{name:28} {len(each):4} songs {sum(each) / 60:7.1f} minutes")
    print(f"{'all':28} {len(rows):4} songs {sum(map(sum, total.values())) / 60:7.1f} minutes")


if __name__ == "__main__":
    main()
