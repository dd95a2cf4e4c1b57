"""The commands by name: the file that brings each, its page of the manual, and the satellite that it is of.

A file is imported when its command is asked for, or all are listed. A satellite is a part that the rest does without:
it imports the core, nothing of the core imports it, and where its folders are missing its commands are, too.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import typer

from mocap.cli.options import Command


@dataclass(frozen=True, kw_only=True)
class Satellite:
    """A part that the rest does without.

    Attributes:
        packages: Its folders, as they are imported.
        commands: Files of its commands, beside this one.
        needs: Other satellites that it imports.
    """

    packages: tuple[str, ...]
    commands: tuple[str, ...]
    needs: tuple[str, ...] = ()

    def present(self) -> bool:
        """Whether all of it is there."""
        return all(map(_found, self.packages)) and all(SATELLITES[name].present() for name in self.needs)


@cache
def _found(package: str) -> bool:
    return find_spec(package) is not None


SATELLITES = {
    "batches": Satellite(packages=("mocap.batches",), commands=("batch",)),
    "calibration": Satellite(packages=("mocap.calibration",), commands=("calibrate",)),
    "desk": Satellite(
        packages=("mocap.desk", "mocap.digitising", "mocap.web"),
        commands=("desk", "digitise", "label"),
        needs=("batches",),
    ),
    "joint design": Satellite(packages=("mocap.joint_design", "eal.joint_design"), commands=("design_joint",)),
    "paper": Satellite(packages=("mocap.reproduce",), commands=("reproduce",)),
}
"""The satellites by name."""


@dataclass(frozen=True)
class CommandFile:
    """A command.

    Attributes:
        file: The file beside this one that has a function, or a group of commands, of that name.
        page: Page of the manual, for errors whose kind has none of its own; None: there is none.
        satellite: Which one it is of; None: of the core.
        function: Its name there; None: that of the command.
    """

    file: str
    page: str | None
    satellite: str | None = None
    function: str | None = None


ENTRIES = {
    "info": CommandFile("info", "your_files"),
    "convert": CommandFile("convert", "your_files"),
    "triangulate": CommandFile("convert", "your_files"),
    "digitise": CommandFile("digitise", "digitising", "desk"),
    "label": CommandFile("label", "digitising", "desk"),
    "track": CommandFile("track", "your_files"),
    "batch": CommandFile("batch", "batch", "batches"),
    "desk": CommandFile("desk", "desk", "desk"),
    "kinematics": CommandFile("kinematics", "kinematics"),
    "learn": CommandFile("learn", "several_recordings"),
    "skeleton": CommandFile("skeleton", "skeleton"),
    "demo": CommandFile("demo", "first_bat"),
    "view": CommandFile("view", "looking"),
    "share": CommandFile("view", "looking"),
    "reproduce": CommandFile("reproduce", "potential", "paper"),
    "design-joint": CommandFile("design_joint", "mechanism", "joint design"),
    "compare-joints": CommandFile("compare_joints", "comparing"),
    "mobility": CommandFile("mobility", "comparing"),
    "help": CommandFile("help", None, function="help_"),
    "data": CommandFile("data", "truth"),
    "calibrate": CommandFile("calibrate", "calibration", "calibration"),
}
"""The commands, in the order of ``mocap --help``."""


def of_folders() -> Any:
    """What ``mocap info`` tells folders by, which the satellite of batches finds trials in; None: it is missing."""
    entry = ENTRIES["batch"]
    if not SATELLITES["batches"].present():
        return None
    return import_module(f"mocap.cli.{entry.file}").describe_folder


class Commands(Mapping[str, Any]):
    """Commands by name, each imported when it is asked for; those of satellites that are missing are missing."""

    def __init__(self) -> None:
        """Those of the core, and of the satellites that are there."""
        self._names = [
            name for name, one in ENTRIES.items() if one.satellite is None or SATELLITES[one.satellite].present()
        ]

    def __getitem__(self, name: str) -> Any:
        """A command as typer runs it."""
        if name not in self._names:
            raise KeyError(name)
        return _command(name)

    def __contains__(self, name: object) -> bool:
        """Without importing it."""
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        """Their names."""
        return iter(self._names)

    def __len__(self) -> int:
        """How many there are."""
        return len(self._names)


@cache
def _command(name: str) -> Any:
    entry, holder = ENTRIES[name], typer.Typer()
    found = getattr(import_module(f"mocap.cli.{entry.file}"), entry.function or name.replace("-", "_"))
    if isinstance(found, typer.Typer):
        holder.add_typer(found, name=name)
    else:
        holder.command(name, cls=Command)(found)
    return typer.main.get_group(holder).commands[name]
