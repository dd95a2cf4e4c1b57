"""The command line: ``mocap``."""

import errno
import os
import signal
import sys
import traceback
from importlib import metadata
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from eal.needs import MissingPackageError
from mocap.cli.console import in_words_of, say, say_error, show_text, talk_in_any_encoding, visible
from mocap.cli.table import ENTRIES, Commands
from mocap.errors import MocapError, shown_elsewhere

DEBUG, DEBUG_VARIABLE = "--debug", "MOCAP_DEBUG"
TROUBLE, FAULT, STOPPED, TERMINATED = 1, 70, 130, 143
"""Exit codes: what a user can mend, a fault of the program (EX_SOFTWARE of sysexits.h), Ctrl-C, and SIGTERM."""
INSTALLING = "installing"
"""The page (of ``mocap help``) for what is not installed, or not as it should be."""
_FULL = (errno.ENOSPC, errno.EDQUOT)


class _Stopped(Exception):
    """Ctrl-C, which typer would turn into an exit without a word."""


class Terminated(KeyboardInterrupt):
    """The request to end that a scheduler or ``kill`` sends: it ends a command as Ctrl-C does."""


def _terminate(_number: int, _frame: object) -> None:
    raise Terminated


class _Commands(TyperGroup):
    """The commands of the table; what the user typed is shown in messages without acting on the terminal."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = Commands()  # type: ignore[assignment]  # none is added

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise _Stopped from error
        except MocapError as error:
            if ctx.invoked_subcommand in ENTRIES:
                error.page = error.page or ENTRIES[ctx.invoked_subcommand].page
            raise
        except Exception as error:
            if hasattr(error, "format_message") and hasattr(error, "message"):  # wrong usage
                error.message = visible(str(error.message))  # type: ignore[attr-defined]
            raise


app = typer.Typer(
    cls=_Commands,
    invoke_without_command=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    epilog=f"{DEBUG} (anywhere on the line) or {DEBUG_VARIABLE}=1: print the full traceback of an internal error, "
    "to report it.",
)
START = """\
mocap demo bat --out out/demo         a first look: tracks a built-in bat, in a minute or two
mocap info FILES                      what is in your files, and what is wrong with them
mocap skeleton FILES > animal.toml    proposes bones and joints, for you to correct
mocap track FILES --skeleton animal.toml --out out/trial    then: mocap view out/trial
mocap --help                          all commands; mocap help first_bat goes through them"""
"""What to do next, in five lines, for who types ``mocap`` alone."""


@app.callback()
def start(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    """Motion capture of animals: clean marker tracks, gaps filled with honest uncertainty, empirical potentials."""
    if version:
        show_text(f"mocap {metadata.version('eal-mocap')}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        show_text(START)


def main() -> None:
    """Run, and turn every trouble into one line and an exit code."""
    read_names_as_utf8()
    talk_in_any_encoding()
    debug = bool(os.environ.get(DEBUG_VARIABLE))
    if DEBUG in sys.argv[1:]:
        sys.argv.remove(DEBUG)
        debug = True
    in_words_of(lambda: typer.main.get_command(app))
    signal.signal(signal.SIGTERM, _terminate)
    try:
        app(standalone_mode=True)
    except SystemExit:
        raise
    except BaseException as error:  # whatever it is; a panic of a Rust library is no Exception
        if debug and not isinstance(error, (MocapError, _Stopped, KeyboardInterrupt)):
            traceback.print_exception(error)
        sys.exit(explain(error))


def read_names_as_utf8() -> None:
    """Start again in Python's UTF-8 mode where names of files are read as ASCII (a C locale).

    Libraries of this program take paths as UTF-8 only; the mode cannot be changed while Python runs. What is said stays
    in the encoding of the terminal.
    """
    if os.name == "posix" and sys.getfilesystemencoding().lower() not in ("utf-8", "utf8"):
        os.environ.setdefault("PYTHONIOENCODING", f"{sys.stdout.encoding}:backslashreplace")
        os.execv(sys.executable, [sys.executable, "-X", "utf8=1", *sys.orig_argv[1:]])


def explain(error: BaseException) -> int:
    """Say in one line what went wrong and what to do; the exit code.

    An error that knows what was kept of the output says so in its attribute ``kept``.
    """
    cause = error.__cause__ if isinstance(error, _Stopped) else error
    kept = getattr(cause, "kept", None)
    if isinstance(error, (_Stopped, KeyboardInterrupt)):
        say(f"stopped: {kept or 'nothing was written'}")
        return TERMINATED if isinstance(cause, Terminated) else STOPPED
    ending = f"; {kept}" if kept else ""
    if _disk_is_full(error) and not (isinstance(error, MocapError) and _names_it(error)):
        place = f" ({error.filename})" if isinstance(error, OSError) and error.filename else ""
        say_error(f"the disk is full, or your quota is used up{place}: free some space, or give another --out{ending}")
        return TROUBLE
    if isinstance(error, MissingPackageError):  # an extra, whose message says how to install it
        say_error(f"{error}{ending}; see: mocap help {INSTALLING}")
        return TROUBLE
    if isinstance(error, MocapError):
        say_error(f"{error}{ending}" + (f"; see: mocap help {error.page}" if error.page else ""))
        return TROUBLE
    if isinstance(error, UnicodeEncodeError) and error.reason == "surrogates not allowed":
        name = error.object[max(0, error.start - 30) : error.end + 30]
        say_error(f"{name}: this file name is not UTF-8: rename the file, or its folder{ending}")
        return TROUBLE
    if isinstance(error, MemoryError):
        detail = f" ({error})" if str(error) else ""
        say_error(
            f"there is not enough memory{detail}: close other programs, or take a shorter part of the recording{ending}"
        )
        return TROUBLE
    if isinstance(error, OSError) and error.filename and error.strerror:
        advice = f"{shown_elsewhere(error)}check that it is there and that you may use it"
        say_error(f"{os.fspath(error.filename)}: {error.strerror}: {advice}{ending}")
        return TROUBLE
    place = traceback.extract_tb(error.__traceback__)
    where = f" at {os.path.basename(place[-1].filename)}:{place[-1].lineno}" if place else ""
    say_error(
        f"{type(error).__name__}{where}: {str(error)[:300] or 'no further details'}: this is an error in mocap, not "
        "in your data: please report this line to its authors, together with the output of the same command with "
        f"{DEBUG}{ending}"
    )
    return FAULT


def _disk_is_full(error: BaseException) -> bool:
    """Whether an error, or what it came from, is of a full disk; libraries in C and Rust tell it by its words only."""
    found: BaseException | None = error
    while found is not None:
        if isinstance(found, OSError) and found.errno in _FULL:
            return True
        if _names_it(found):
            return True
        found = found.__cause__ or found.__context__
    return False


def _names_it(error: BaseException) -> bool:
    return any(os.strerror(number) in str(error) for number in _FULL)
