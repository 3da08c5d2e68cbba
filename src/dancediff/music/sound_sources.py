"""Where sound comes from block by block: a song that plays, and a microphone.

    music = CausalMusic(rate=22050)
    for block in microphone(rate=22050):
        music.push(block)

Read first: `dancediff.music.causal`.
"""

import queue
import time
from collections.abc import Callable, Iterator

import numpy as np

from dancediff.music.song import Music

BLOCK = 0.1  # seconds
PATIENCE = 5.0  # seconds without a block after which a microphone counts as gone


def played(
    song: Music,
    *,
    block: float = BLOCK,
    in_real_time: bool = True,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[np.ndarray]:
    """Blocks of a song, (n, channels) at ``song.rate``: when they have sounded, or at once.

    Who is late for a block gets the next ones without a wait, so time is never lost for good.

    Raises: ValueError for a block that is shorter than a sample.

    >>> song = Music(np.zeros((25, 2)), 100)
    >>> [block.shape for block in played(song, in_real_time=False)]
    [(10, 2), (10, 2), (5, 2)]
    """
    step = round(block * song.rate)
    if step < 1:
        raise ValueError(f"block={block} s must hold a sample at {song.rate} samples a second")
    begin = clock()
    for start in range(0, len(song.audio), step):
        part = np.asarray(song.audio[start : start + step])
        wait = begin + (start + len(part)) / song.rate - clock()
        if in_real_time and wait > 0:
            sleep(wait)
        yield part


def microphone(
    rate: int = 22050, *, block: float = BLOCK, device: int | str | None = None
) -> Iterator[np.ndarray]:
    """Blocks of the sound of a microphone, (n, 1), until the loop ends.

    It begins with the first block that is asked for.

    ``device``: number or name, as ``python -m sounddevice`` lists them; by default the system's.

    Raises: ImportError without sounddevice or PortAudio; ValueError where no microphone
    answers, or it gives nothing any more.
    """
    try:
        import sounddevice
    except (ImportError, OSError) as err:  # OSError: PortAudio is not there
        raise ImportError(
            'the microphone needs sounddevice and PortAudio: pip install "dancediff[microphone]", '
            "on Debian also apt install libportaudio2"
        ) from err
    blocks: queue.SimpleQueue[np.ndarray] = queue.SimpleQueue()

    def keep(samples, frames, seconds, status) -> None:
        blocks.put(samples.copy())  # the library uses the array again

    options = {"samplerate": rate, "channels": 1, "dtype": "float32", "device": device}
    try:
        stream = sounddevice.InputStream(blocksize=round(block * rate), callback=keep, **options)
    except (sounddevice.PortAudioError, ValueError) as err:
        raise ValueError(
            f"device={device!r} gives no sound at rate={rate}; `python -m sounddevice` lists those "
            "that there are"
        ) from err
    return _arriving(stream, blocks, device)


def _arriving(stream, blocks: "queue.SimpleQueue[np.ndarray]", device) -> Iterator[np.ndarray]:
    with stream:
        while True:
            try:
                yield blocks.get(timeout=PATIENCE)
            except queue.Empty as err:
                raise ValueError(
                    f"device={device!r} gives no sound any more; plug it in, and begin again"
                ) from err
