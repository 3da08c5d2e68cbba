"""What the server of a live session answers: page, sound and websocket.

Read first: `dancediff.live_dance.server`, which imports this module when it runs: it needs tornado.
"""

import tornado.web
import tornado.websocket

from dancediff.live_dance.sound import asked_range


class _Checked:
    """Refuses requests by other names than 127.0.0.1, and those of other sites' pages."""

    def prepare(self):
        request = self.request
        if not self.server.allows(request.host, request.headers.get("Origin")):
            raise tornado.web.HTTPError(403, reason="only the page of this session may ask")


class _Handler(_Checked, tornado.web.RequestHandler):
    def initialize(self, server):
        self.server = server

    def set_default_headers(self):
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.clear_header("Server")


class PageHandler(_Handler):
    """The page."""

    def get(self):
        """Refuses a second client while there is one."""
        if self.server.client is not None:
            self.set_status(409)
            self.set_header("Content-Type", "text/plain; charset=utf-8")
            self.finish("This dance is shown in another tab already; close that one first.\n")
            return
        self.finish(self.server.page())


class SongHandler(_Handler):
    """The song, in the parts that the browser asks for."""

    def get(self):
        """A part, or the first bytes of the whole."""
        wav = self.server.wav
        if wav is None:
            raise tornado.web.HTTPError(404, reason="the sound is in the room")
        try:
            start, stop = asked_range(self.request.headers.get("Range"), wav.size)
        except ValueError as error:
            self.set_header("Content-Range", f"bytes */{wav.size}")
            raise tornado.web.HTTPError(416, reason="outside of the song") from error
        body = wav.part(start, stop)
        self.set_status(206)
        self.set_header("Content-Type", "audio/wav")
        self.set_header("Accept-Ranges", "bytes")
        self.set_header("Content-Range", f"bytes {start}-{start + len(body) - 1}/{wav.size}")
        self.finish(body)


class SessionSocket(_Checked, tornado.websocket.WebSocketHandler):
    """The one client's connection."""

    def initialize(self, server):
        """Of a `LiveServer`."""
        self.server = server

    def prepare(self):
        """Refuse a second client before a connection is made."""
        super().prepare()
        if self.server.client is not None:
            raise tornado.web.HTTPError(409, reason="this session has a client already")

    def check_origin(self, origin):
        """`prepare` has looked; a page must have an origin."""
        return self.server.allows(self.request.host, origin)

    def open(self):
        """Hand over what is there already."""
        if self.server.client is not None:
            self.close(1008, "This dance is shown in another tab already.")
            return
        self.set_nodelay(True)
        self.server.opened(self)

    def on_message(self, message):
        """A wish, or where the player is."""
        self.server.heard(message)

    def on_close(self):
        """The tab was closed."""
        if self.server.client is self:
            self.server.closed()


def application(server) -> tornado.web.Application:
    """All that is answered."""
    facts = {"server": server}
    return tornado.web.Application(
        [
            (r"/", PageHandler, facts),
            (r"/song\.wav", SongHandler, facts),
            (r"/session", SessionSocket, facts),
        ],
        websocket_ping_interval=5,
        log_function=lambda handler: None,
    )
