"""A small server on 127.0.0.1: the page of a live session, its sound, and one websocket.

Read first: `dancediff.live_dance.session` · `dancediff.live_dance.page`.

Other computers cannot reach it, pages of other sites are refused, and so is a second client. It
ends, and the session with it, once the tab is closed, or the notebook's cell is run again. What was
danced is kept: in a notebook ``live.save()`` still writes it.
"""

import asyncio
import contextlib
import json
import threading
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

from dancediff.live_dance.page import live_page, piece_facts
from dancediff.live_dance.session import LiveSession
from dancediff.live_dance.sound import WavFile
from dancediff.music.live_song import LiveSong
from dancediff.threads import Worker

HOST = "127.0.0.1"
NAMES = (HOST, "localhost")
SET, SEEK, AT, SAVE = "set", "seek", "at", "save"


class LiveServer:
    """Shows one session to one client; `start` serves in a thread, `run` until the tab is closed.

    - ``save``: what "Save" does; gets the session, returns the files.
    - ``options``: those of `LiveSession`.

    Raises: ImportError naming the extra when tornado is not installed; ValueError as
    `LiveSession`.
    """

    def __init__(
        self,
        pipeline,
        song,
        *,
        port: int = 0,
        save: Callable[[LiveSession], list[Path]] | None = None,
        **options,
    ):
        _need_tornado()
        self._told: list[str] = []  # for a client that is not there yet
        self._loop: asyncio.AbstractEventLoop | None = None
        self._end: asyncio.Event | None = None
        self._up = threading.Event()
        self._saving = threading.Lock()  # who clicks twice has it saved twice, not at once
        self._failed: BaseException | None = None
        self.client = None
        self.asked_port, self.port, self.save = port, 0, save
        self.wav = None if isinstance(song, LiveSong) else WavFile(song)
        self.session = LiveSession(pipeline, song, tell=self._tell, **options)
        self._thread: Worker | None = None

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{HOST}:{self.port}/"

    @property
    def host(self) -> str:
        """Name and port."""
        return f"{HOST}:{self.port}"

    def start(self) -> "LiveServer":
        """Serve in a thread of its own; returns once the page can be loaded.

        Raises: OSError when the port is taken.
        """
        self.session.start()
        self._thread = Worker(self._serve, stop=self.stop).begin()
        self._up.wait()
        if self._failed is not None:
            self.session.stop()
            raise self._failed
        return self

    def wait(self) -> None:
        """Until the tab is closed."""
        assert self._thread is not None
        while self._thread.is_alive():
            self._thread.join(0.2)  # short, so that Ctrl-C is heard

    def stop(self) -> None:
        """End session and server."""
        self.session.stop()
        if self._end is not None:
            self._call(self._end.set)

    @property
    def is_running(self) -> bool:
        """Whether the page can still be loaded."""
        return self._thread is not None and self._thread.is_alive()

    def _serve(self) -> None:
        try:
            asyncio.run(self._until_closed())
        except OSError as error:
            self._failed = error
        finally:
            self.session.stop()
            self._up.set()

    async def _until_closed(self) -> None:
        from tornado.httpserver import HTTPServer
        from tornado.netutil import bind_sockets

        from dancediff.live_dance.handlers import application

        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        sockets = bind_sockets(self.asked_port, HOST)
        self.port = sockets[0].getsockname()[1]
        server = HTTPServer(application(self))
        server.add_sockets(sockets)
        self._up.set()
        await self._end.wait()
        server.stop()
        if self.client is not None:
            self.client.close(1000, "The session has ended.")
        await server.close_all_connections()

    def page(self) -> str:
        """The page as HTML."""
        return live_page(self.session, self.host)

    def allows(self, host: str, origin: str | None) -> bool:
        """Whether a request to ``host`` from a page of ``origin`` is answered."""
        ours = {f"{name}:{self.port}" for name in NAMES}
        return host in ours and (origin is None or urlsplit(origin).netloc in ours)

    def opened(self, client) -> None:
        """A client is there: it gets all that was told so far."""
        self.client = client
        for text in self._told:
            client.write_message(text)
        self._told.clear()

    def closed(self) -> None:
        """The client is gone, and with it the session; what was danced can still be saved."""
        assert self._end is not None
        self.client = None
        self.session.stop()
        self._end.set()

    def heard(self, text: str) -> None:
        """Do what the client asks for; what it may not ask for is answered with a reason."""
        try:
            facts = json.loads(text)
            if AT in facts:
                self.session.played(facts[AT], facts.get("stalls", 0))
            if SET in facts:
                self.session.set(**facts[SET])
            if SEEK in facts:
                self.session.seek(facts[SEEK])
            if SAVE in facts:
                Worker(self._save).begin()
        except (ValueError, TypeError, AttributeError) as error:
            self._send("failed", {"text": " ".join(str(error).split())})

    def _save(self) -> None:
        if self.save is None:
            self._tell("failed", {"text": "This page was started without a place to save to."})
            return
        try:
            with self._saving:
                files = self.save(self.session)
            self._tell("saved", {"files": [str(file) for file in files]})
        except Exception as error:  # the page says so, and the dance goes on
            self._tell("failed", {"text": " ".join(str(error).split())})

    def _tell(self, kind: str, facts: dict) -> None:
        """From the session's thread to the page."""
        if kind == "piece":
            facts = piece_facts(facts["start"], facts["motion"])
        if kind == "beats":
            facts = {"beats": [round(float(beat), 3) for beat in facts["beats"]]}
        text = json.dumps([kind, facts], default=str)
        if self._loop is None:
            self._told.append(text)
        else:
            self._call(self._pass_on, text)

    def _call(self, function: Callable, *values) -> None:
        """In the server's thread; nothing when the server has ended."""
        assert self._loop is not None
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(function, *values)

    def _send(self, kind: str, facts: dict) -> None:
        self._pass_on(json.dumps([kind, facts]))

    def _pass_on(self, text: str) -> None:
        if self.client is None:
            self._told.append(text)
        else:
            self.client.write_message(text)


def _need_tornado() -> None:
    try:
        import tornado  # noqa: F401
    except ImportError as err:
        raise ImportError('live dancing needs tornado: pip install "dancediff[notebooks]"') from err
