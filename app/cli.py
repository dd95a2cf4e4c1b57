"""The command line: ``mocap``."""

import sys

import typer

from app.commands.calibrate import calibrate
from app.commands.console import errors
from app.commands.convert import convert
from app.commands.data import data
from app.commands.demo import demo
from app.commands.design_joint import design_joint
from app.commands.info import info
from app.commands.learn import learn
from app.commands.reproduce import reproduce
from app.commands.share import share
from app.commands.track import track
from app.commands.triangulate import triangulate
from app.commands.view import view
from mocap.errors import MocapError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Motion capture of animals: clean marker tracks, gaps filled with honest uncertainty, empirical potentials.",
)
for command in (info, convert, triangulate, track, learn, demo, view, share, reproduce, design_joint):
    app.command()(command)
app.add_typer(data, name="data")
app.add_typer(calibrate, name="calibrate")


def main() -> None:
    """Run, and turn trouble that a user can mend into one line and exit code 1."""
    try:
        app(standalone_mode=True)
    except MocapError as error:
        errors.print(f"error: {error}", style="red", highlight=False, soft_wrap=True, markup=False)
        sys.exit(1)
