"""Output of the commands: progress, findings, what was written; names and paths cannot control the terminal."""

import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderHook, RenderResult
from rich.segment import Segment

from mocap.progress import bars, in_words, left_s
from mocap.text import OTHER_OPTIONS, visible, with_options


class _Visible:
    """What is printed, with every character that acts made visible; the console's own control codes stay."""

    def __init__(self, printed: ConsoleRenderable) -> None:
        self.printed = printed

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for segment in console.render(self.printed, options):
            yield segment if segment.control else Segment(visible(segment.text), segment.style)


class _Shield(RenderHook):
    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        return [_Visible(printed) for printed in renderables]


def _console(*, stderr: bool) -> Console:
    console = Console(stderr=stderr, markup=False, emoji=False, highlight=False)
    console.push_render_hook(_Shield())
    return console


errors = _console(stderr=True)
output = _console(stderr=False)
"""The two streams; neither reads markup or emoji codes in what it is given."""


_commands: list[Callable[[], object]] = []


def in_words_of(command: Callable[[], object]) -> None:
    """From now on arguments that messages name are said as options of this command and those below it."""
    _commands[:] = [command]


def option_names(command: Any) -> dict[str, str]:
    """The first option of each parameter of a command and of those below it, by the parameter's name."""
    found = {p.name: p.opts[0] for p in command.params if p.opts and p.opts[0].startswith("--")}
    for below in getattr(command, "commands", {}).values():
        found |= option_names(below)
    return found | OTHER_OPTIONS


def in_options(text: str) -> str:
    """A message with options in place of arguments; the commands are looked at only where there is one."""
    return with_options(text, option_names(_commands[0]())) if _commands and "`" in text else text


def say(*lines: str) -> None:
    """Lines on stderr, none broken."""
    errors.print(visible(in_options("\n".join(lines))), soft_wrap=True)


def say_error(text: str) -> None:
    """One line on stderr that tells what went wrong."""
    errors.print(visible(in_options("error: " + " ".join(text.split("\n")))), style="red", soft_wrap=True)


def show(markdown: str) -> None:
    """Markdown on stdout."""
    from rich.markdown import Markdown  # a fifth of what a command imports, for few of them

    output.print(Markdown(visible(in_options(markdown)), hyperlinks=False))


def show_text(text: str) -> None:
    """Lines on stdout, none broken."""
    output.print(visible(in_options(text)), soft_wrap=True)


def talk_in_any_encoding(streams: Iterable[object] = ()) -> None:
    """What a stream cannot say (a C locale, an old code page) is written as an escape, and raises nothing."""
    for stream in streams or (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="backslashreplace")


@contextmanager
def progress() -> Iterator[Callable[[str, float], None]]:
    """Told of a stage and the share of it that is done: a bar a stage on a terminal, else a line now and then."""
    if not errors.is_terminal:
        yield _Lines(say)
        return
    with bars(errors) as tell:
        yield tell


MOST_SILENT_S = 60.0
"""Nobody waits longer for a sign of life; an hour takes some sixty lines."""


class _Lines:
    """Progress where there is no terminal, as in a log: nothing in the first seconds, then lines now and then."""

    def __init__(self, say_line: Callable[[str], None], *, every_s: float = 10.0) -> None:
        self.say_line, self.every_s = say_line, every_s
        self.begun = self.said = time.monotonic()
        self.stage, self.stage_begun = "", self.begun

    def __call__(self, stage: str, share: float) -> None:
        now = time.monotonic()
        if stage != self.stage:
            self.stage, self.stage_begun = stage, now
        if now - self.said < self.every_s or share >= 1:
            return
        self.said, self.every_s = now, min(2 * self.every_s, MOST_SILENT_S)
        spent = now - self.stage_begun
        left = f", about {in_words(left_s(spent, share) or 0.0)} left" if share > 0.05 and spent > 2 else ""
        done = f", {share:.0%} done" if share > 0 else ""
        self.say_line(f"{now - self.begun:.0f} s: {stage}{done}{left}")


def typed(*words: object) -> str:
    """A command as it can be typed or pasted, with quotes where spaces need them."""
    texts = [str(word) for word in words]
    return subprocess.list2cmdline(texts) if sys.platform == "win32" else shlex.join(texts)


def program() -> tuple[str, ...]:
    """This command as its user can call it again; what uvx and pipx run is in a folder that they take away."""
    prefix = Path(sys.prefix).parts
    if any(part.startswith("archive-v") for part in prefix):
        return ("uvx", "eal-mocap")
    if "pipx" in prefix and ".cache" in prefix:
        return ("pipx", "run", "eal-mocap")
    found = shutil.which("mocap")
    called = Path(sys.argv[0])
    return ("mocap",) if found is not None and Path(found).resolve() == called.resolve() else (str(called),)
