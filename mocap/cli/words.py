"""Messages of the library name its arguments, as `fps`; those of the command line name the options, as --fps."""

from typing import Any

OTHER = {"overwrite": "--force", "no_solid": "--no-solid"}
"""Arguments whose options have another name, beside those of ``mocap.read``."""


def option_names(command: Any) -> dict[str, str]:
    """The first option of each parameter of a command and of those below it, by the parameter's name."""
    from mocap.pipeline.reading import OPTIONS  # which loads all that reads

    found = {p.name: p.opts[0] for p in command.params if p.opts and p.opts[0].startswith("--")}
    for below in getattr(command, "commands", {}).values():
        found |= option_names(below)
    return found | OTHER | OPTIONS
