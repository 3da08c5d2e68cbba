"""`dancediff live`: a page in the browser on which a dance is made while it plays.

Read first: `dancediff.cli.options` · `dancediff.live_dance.server`.
"""

from dataclasses import dataclass, fields, make_dataclass
from pathlib import Path

import tyro

from dancediff.cli.files import check_folder, check_formats, check_targets, song_named
from dancediff.cli.options import NOT_HERE, command_option
from dancediff.generation.tcdiffpp_request import TCDiffPPRequest


@dataclass
class _Live:
    """What there is beside the options of a request."""

    song: tyro.conf.Positional[str | None] = None
    """A wav, flac, ogg or mp3 file; 'packaged' for the song that comes with dancediff."""
    microphone: bool = False
    """Dance to what the computer's microphone hears, instead of a song: for 600 s, or for so many
    --seconds."""
    model: str = "tcdiffpp"
    """A packaged model of TCDiff++, or a model folder."""
    own: str | None = None
    """The class of a model folder whose network is your own: MODULE:CLASS."""
    out: Path = Path("out")
    """Folder for what "Save" on the page writes."""
    formats: str = "npz,html"
    """Which files "Save" writes, of npz, mp4, png, html (a player), glb; bvh, smpl."""
    port: int = 0
    """Of the page, on this computer only; 0: any that is free."""
    browser: bool = True
    """Open the page."""

    def run(self) -> None:
        """Serve the page until its tab is closed."""
        import webbrowser

        from dancediff import hub
        from dancediff.live_dance.notebook import source_of
        from dancediff.live_dance.server import LiveServer

        formats = check_formats(self.formats)
        check_folder(self.out)
        check_targets(self.out, formats)
        if not 0 <= self.port < 65536:
            raise ValueError(f"--port {self.port} must lie in 0 ... 65535")
        options = {name: value for name in OPTIONS if (value := getattr(self, name)) is not None}
        named = None if self.song is None else song_named(self.song)
        model = hub.load(self.model, own=self.own)
        try:
            song = source_of(named, self.microphone, options.get("seconds"))
            server = LiveServer(
                model,
                song,
                port=self.port,
                save=lambda session: session.save(self.out, formats),
                **options,
            ).start()
        except ImportError as error:
            raise RuntimeError(str(error)) from error
        print(f"{song.name!r} is danced to at {server.address}; close the tab to end.", flush=True)
        if self.browser:
            webbrowser.open(server.address)
        try:
            server.wait()
        finally:
            server.stop()


OPTIONS = {one.name: one for one in fields(TCDiffPPRequest) if one.name not in NOT_HERE}
Live = make_dataclass("Live", map(command_option, OPTIONS.values()), bases=(_Live,))
Live.__doc__ = "Make a group dance while the song plays, on a page in the browser."
