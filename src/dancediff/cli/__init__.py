"""The command line: ``dancediff generate``, evaluate, gallery, prepare, train, ...

Exit status: 0 done, 1 nothing could be done though the arguments were fine, 2 bad arguments or
input; the last line then names the value and the fix. torch is imported inside commands only.
"""

import contextlib
import errno
import io
import os
import sys
import warnings
from typing import Annotated, Any

import tyro

from dancediff import __version__
from dancediff.cli.commands import COMMANDS, Generate
from dancediff.cli.explain import explain


def main(args: list[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    # torch reads it when a command imports it. Its threads wait for each other actively, now not
    # for long: 5 s of dance beside two busy programs took 19 s instead of more than 100.
    os.environ.setdefault("GOMP_SPINCOUNT", "5000")
    if isinstance(sys.stdout, io.TextIOWrapper):  # a Windows code page has no ✓
        sys.stdout.reconfigure(errors="replace")
    # a warning is a sentence for the user; the line of code it comes from is none
    warnings.formatwarning = lambda message, *_, **__: f"dancediff: {message}\n"
    args = sys.argv[1:] if args is None else args
    if args == ["--version"]:
        print(f"dancediff {__version__}")
        return 0
    try:
        _parse(args).run()
        sys.stdout.flush()
    except BrokenPipeError:  # whoever read what we print has gone, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + 13  # as if SIGPIPE had ended us
    except (ValueError, OSError, RuntimeError, ImportError) as err:
        fix = "; check the path, its permissions and the free space"
        if isinstance(err, OSError) and err.errno == errno.EADDRINUSE:
            fix = "; name another port, or 0 for a free one"
        is_disk = isinstance(err, OSError) and not isinstance(err, ValueError)
        if isinstance(err, ModuleNotFoundError):  # ours are ImportErrors that name their fix
            fix = "; `dancediff doctor` says what is missing"
        has_fix = is_disk or isinstance(err, ModuleNotFoundError)
        print(f"dancediff: {_one_line(err)}{fix if has_fix else ''}", file=sys.stderr)
        return 1 if isinstance(err, RuntimeError | ImportError) else 2
    except KeyboardInterrupt:
        print("dancediff: stopped", file=sys.stderr)
        return 130
    return 0


def _parse(args: list[str]):
    union: Any = Annotated[Generate, tyro.conf.subcommand("generate", prefix_name=False)]
    for name, command in list(COMMANDS.items())[1:]:
        union = union | Annotated[command, tyro.conf.subcommand(name, prefix_name=False)]
    words = io.StringIO()
    try:
        with contextlib.redirect_stderr(words):
            return tyro.cli(union, args=args, prog="dancediff")
    except SystemExit as stop:
        if stop.code in (0, None):  # --help
            raise
        raise ValueError(explain(args, words.getvalue())) from stop


def _one_line(err: BaseException) -> str:
    return " ".join(str(err).split()) or type(err).__name__
