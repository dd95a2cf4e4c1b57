"""Reference of the command line, read off the program itself."""

import re
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any, get_args

import typer

from mocap.cli.main import app


@cache
def commands() -> dict[str, Any]:
    """Every command by what is typed, ``mocap calibrate wand``, in the order of ``mocap --help``."""
    found: dict[str, Any] = {}

    def walk(command: Any, words: str) -> None:
        below = getattr(command, "commands", None)
        if below is None:
            found[words] = command
        for name, one in (below or {}).items():
            walk(one, f"{words} {name}")

    walk(typer.main.get_command(app), "mocap")
    return found


def options(command: Any) -> set[str]:
    """All spellings of the options of a command, ``--help`` included."""
    return {one for p in command.params for one in (*p.opts, *p.secondary_opts) if one.startswith("-")} | {"--help"}


def unknown_in(line: str) -> list[str]:
    """What a typed command names that the program does not have: the command itself, or options.

    Args:
        line: As a page shows it, ``mocap track trial.csv --fps 700    # a comment``; other programs' lines pass.
    """
    words = line.split("#")[0].split()
    while words and "=" in words[0]:
        words = words[1:]
    if not words or words[0] != "mocap":
        return []
    known = commands()
    name = next((" ".join(words[:n]) for n in (3, 2) if " ".join(words[:n]) in known), None)
    if name is None:
        groups = {" ".join(known_name.split()[:2]) for known_name in known if len(known_name.split()) == 3}
        group = " ".join(words[:2]) in groups
        whole = len(words) == 1 or words[1].startswith("-") or (group and len(words) == 2)
        return [] if whole else [" ".join(words[: 3 if group else 2])]
    given = {re.split(r"[=\]]", w)[0].strip("[") for w in words if w.strip("[").startswith("--")}
    return sorted(given - options(known[name]) - {"--debug"})


def page() -> str:
    """The reference of all commands, in Markdown."""
    parts = [
        "# Commands\n",
        "Made from the program's own code. `mocap COMMAND --help` says the same in the terminal. Results go to `--out` "
        "or the standard output, messages to the standard error. Exit codes: 0 done; 1 the data cannot be processed, "
        "with one line that says what to do; 2 wrong usage; 70 an error in mocap; 130 stopped by Ctrl-C. `--debug`, "
        "anywhere on the line, or `MOCAP_DEBUG=1` prints the full traceback of an internal error.\n",
    ]
    parts += [_section(name, command) for name, command in commands().items()]
    return "\n".join(parts)


def _section(name: str, command: Any) -> str:
    given = [p for p in command.params if p.param_type_name == "argument"]
    asked = [p for p in command.params if p.param_type_name == "option" and p.name != "help"]
    usage = " ".join([name, *(_usage(p) for p in given), *(f"{p.opts[0]} {_kind(p)}" for p in asked if p.required)])
    text = " ".join((command.help or "").split())
    lines = [f"## {name}\n", f"{text}\n", f"```text\n{usage}{' [OPTIONS]' if asked else ''}\n```\n"]
    if given or asked:
        lines += ["| | |", "|---|---|"]
        lines += [f"| `{_metavar(p)}` | {_told(p)} |" for p in given]
        lines += [f"| {_spelt(p)} | {_told(p)} |" for p in asked]
    return "\n".join([*lines, ""])


def _metavar(parameter: Any) -> str:
    return str(parameter.name).upper() + ("..." if parameter.nargs == -1 else "")


def _usage(parameter: Any) -> str:
    return _metavar(parameter) if parameter.required else f"[{_metavar(parameter)}]"


def _kind(parameter: Any) -> str:
    wanted = parameter.type_descriptor.annotation
    choices = [c.value for c in wanted] if isinstance(wanted, type) and issubclass(wanted, Enum) else get_args(wanted)
    if choices and all(isinstance(c, str) for c in choices):
        return " or ".join(choices)
    return {int: "NUMBER", float: "NUMBER", Path: "PATH"}.get(wanted, "TEXT")


def _spelt(parameter: Any) -> str:
    spelt = ", ".join(f"`{one}`" for one in (*parameter.opts, *parameter.secondary_opts))
    return spelt if parameter.is_flag else f"{spelt} {_kind(parameter)}"


def _told(parameter: Any) -> str:
    text = " ".join((getattr(parameter, "help", None) or "").split()).replace("|", "\\|").replace("<", "&lt;")
    default = parameter.default
    default = getattr(default, "value", default)
    if parameter.required:
        text += " **Required.**"
    elif not (getattr(parameter, "is_flag", False)) and _plain(default):
        text += f" Default: `{default}`."
    if getattr(parameter, "multiple", False):
        text += " May be given several times."
    return text.strip()


def _plain(default: Any) -> bool:
    return default is not None and not callable(default) and str(default) != "" and "UNSET" not in repr(default)
