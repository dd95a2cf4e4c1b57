"""Messages of the library name its arguments, as `fps`; those of the command line name the options, as --fps."""

import re
from typing import Any

OTHER = {
    "overwrite": "--force",
    "image_height_px": "--image-height",
    "stored_points": "--stored",
    "no_solid": "--no-solid",
}
"""Arguments whose options have another name."""


def option_names(command: Any) -> dict[str, str]:
    """The first option of each parameter of a command and of those below it, by the parameter's name."""
    found = {p.name: p.opts[0] for p in command.params if p.opts and p.opts[0].startswith("--")}
    for below in getattr(command, "commands", {}).values():
        found |= option_names(below)
    return found


def with_options(text: str, options: dict[str, str]) -> str:
    """A message in which each argument between backquotes is the option that states it."""
    known = options | OTHER
    return re.sub(r"`(\w+)`", lambda found: known.get(found[1], found[0]), text)
