"""The command line: ``mocap``."""

import atexit
import gc
import os
import re
import signal
import sys
import traceback
from importlib import metadata
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from mocap.cli.console import in_words_of, program, say, say_error, show_text, talk_in_any_encoding, typed, visible
from mocap.cli.table import ENTRIES, Commands
from mocap.errors import MocapError
from mocap.trouble import ended_by_plugin, trouble_of

DEBUG, DEBUG_VARIABLE = "--debug", "MOCAP_DEBUG"
TROUBLE, FAULT, STOPPED, TERMINATED = 1, 70, 130, 143
"""Exit codes: what a user can mend, a fault of the program (EX_SOFTWARE of sysexits.h), Ctrl-C, and SIGTERM."""

OBJECTS = 20_000
"""New objects after which Python looks for circles among them: at its own 700 the 2,000 modules that a command imports
are gone through 600 times, 0.4 s. Memory is the same to 2 %."""


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

    def get_params(self, ctx: Any) -> list[Any]:
        """Switches without the type that typer shows of them."""
        found = super().get_params(ctx)
        for one in found:
            one.metavar = ""  # type: ignore[attr-defined]  # all are switches
        return found

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
        show_text(re.sub(r"\bmocap (?=\S)", lambda _: f"{typed(*program())} ", START))


def main() -> None:
    """Run, and turn every trouble into one line and an exit code."""
    gc.set_threshold(OBJECTS)
    atexit.register(gc.freeze)  # last of all: the end of Python goes through all objects three times, 0.5 s
    read_names_as_utf8()
    talk_in_any_encoding()
    debug = bool(os.environ.get(DEBUG_VARIABLE))
    if DEBUG in sys.argv[1:]:
        sys.argv.remove(DEBUG)
        debug = True
    in_words_of(lambda: typer.main.get_command(app))
    signal.signal(signal.SIGTERM, _terminate)
    try:
        app(standalone_mode=True, prog_name="mocap")
    except SystemExit as stop:
        if not ended_by_plugin(stop):
            raise
        sys.exit(explain(stop))
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
    trouble = trouble_of(error)
    report = f": please report this line to its authors, together with the output of the same command with {DEBUG}"
    page = f"; see: mocap help {trouble.page}" if trouble.page else ""
    say_error(f"{trouble.text}{report if trouble.fault else ''}{ending}{page}")
    return FAULT if trouble.fault else TROUBLE
