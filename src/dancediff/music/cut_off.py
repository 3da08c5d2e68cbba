"""How much of a sound file is missing, by what its header tells: a stopped download, a full disk.

Decoders give what is there without a word, and a dance to half a song looks like one to all of it.
"""

import struct
from pathlib import Path

FEWEST = 0.01  # share of a file from which on it is missed; some writers err by a few bytes
_ENDLESS = 0x7FFF0000  # sizes from here on are written by programs that do not know the length yet


def missing_share(path: Path, told: int, read: int) -> float:
    """Share of the sound that its header tells of and that is not there; 0 where it tells nothing.

    ``told`` and ``read`` are the samples by the decoder's own look at the header, and those that it
    then gave. Ogg tells no length, and a cut-off FLAC file is not read at all.
    """
    with path.open("rb") as file:
        head = file.read(12)
        if head[:4] == b"RIFF" and head[8:] == b"WAVE":
            share = _missing_of_wav(file, path.stat().st_size)
        else:
            share = 1 - read / told if told > 0 and _counts_its_frames(file, head) else 0.0
    return share if share > FEWEST else 0.0


def _missing_of_wav(file, size: int) -> float:
    """libsndfile cuts the told length to the file's, so the header is read here."""
    file.seek(12)
    while len(head := file.read(8)) == 8:
        name, told = struct.unpack("<4sI", head)
        if name == b"data":
            return 1 - (size - file.tell()) / told if 0 < told < _ENDLESS else 0.0
        file.seek(told + told % 2, 1)
    return 0.0


def _counts_its_frames(file, head: bytes) -> bool:
    """Whether an MP3 has the frame that counts the others; without one the length is a guess."""
    tag = 0
    if head[:3] == b"ID3":  # four bytes of seven bits each; pictures of covers may lie in it
        tag = 10 + sum(
            byte << shift for byte, shift in zip(head[6:10], (21, 14, 7, 0), strict=True)
        )
    file.seek(tag)
    frame = file.read(256)
    return b"Xing" in frame or b"Info" in frame
