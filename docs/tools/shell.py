"""The directive ``{run}``: commands that are run while the site is built, with what they print."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from shutil import copyfile

from docutils import nodes
from docutils.parsers.rst import Directive, directives

CONTROLS = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")

PROGRESS = re.compile(r"\d+ s: ")
"""Lines that say how far a command is, and differ each time."""


def run(line: str, work: Path, *, fails: bool = False) -> str:
    """What a line of a shell prints, run in a folder; what a build ran before there is remembered.

    Args:
        line: As it is typed; ``mocap`` is the one of this Python.
        work: The folder.
        fails: Whether it has to end with an error.

    Raises:
        RuntimeError: it ends otherwise.
    """
    kept = work / ".printed" / f"{sha256(line.encode()).hexdigest()[:16]}.json"
    if kept.is_file():
        return json.loads(kept.read_text(encoding="utf-8"))["printed"]
    beside = Path(sys.executable).parent
    environment = os.environ | {"PATH": f"{beside}{os.pathsep}{os.environ['PATH']}", "COLUMNS": "88"}
    done = subprocess.run(
        ["bash", "-c", line],
        cwd=work,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        encoding="utf-8",
        check=False,
        timeout=3600,  # a busy computer
    )
    if (done.returncode != 0) != fails:
        raise RuntimeError(f"{line}: ended with {done.returncode}:\n{done.stdout[-2000:]}")
    printed = CONTROLS.sub("", done.stdout).replace(f"{beside}{os.sep}", "")
    lines = [text.rstrip() for text in printed.strip("\n").splitlines() if not PROGRESS.match(text)]
    printed = "\n".join(lines)
    kept.parent.mkdir(exist_ok=True)
    kept.write_text(json.dumps({"line": line, "printed": printed}), encoding="utf-8")
    return printed


class Run(Directive):
    """Each line of the content is typed, then what it prints follows.

    Options:
        lines: How many printed lines are shown, from the first; the others are told by "...".
        fails: The last line has to end with an error.
        show: A picture that the lines wrote, shown below.
        alt: What that picture shows.
        width: Of the picture.
    """

    has_content = True
    option_spec = {  # noqa: RUF012
        "lines": directives.positive_int,
        "fails": directives.flag,
        "show": directives.unchanged,
        "alt": directives.unchanged,
        "width": directives.unchanged,
    }

    def run(self) -> list[nodes.Node]:
        """The commands, what they print, and the picture."""
        env = self.state.document.settings.env
        work = Path(env.app.config.run_in)
        typed = [line for line in self.content if line.strip()]
        found: list[nodes.Node] = []
        for k, line in enumerate(typed):
            try:
                printed = run(line, work, fails="fails" in self.options and k == len(typed) - 1).splitlines()
            except RuntimeError as error:
                raise self.error(str(error)) from error
            found.append(nodes.literal_block(line, line, language="sh"))
            most = self.options.get("lines", len(printed))
            shown = "\n".join([*printed[:most], *(["..."] if len(printed) > most else [])])
            if shown:
                found.append(nodes.literal_block(shown, shown, language="text", classes=["printed"]))
        if "show" in self.options:
            found.append(self._picture(env, work / self.options["show"]))
        return found

    def _picture(self, env, path: Path) -> nodes.Node:
        folder = Path(env.srcdir) / "pictures" / "made"
        folder.mkdir(parents=True, exist_ok=True)
        name = "-".join(path.relative_to(env.app.config.run_in).parts)
        copyfile(path, folder / name)
        uri = f"/pictures/made/{name}"
        picture = nodes.image(uri=uri, alt=self.options.get("alt", ""))
        if "width" in self.options:
            picture["width"] = self.options["width"]
        return picture


TOLD: list[Callable[[str, float], None]] = []
"""Who is told how far Sphinx is."""


def _tell(stage: str, share: float) -> None:
    for tell in TOLD:
        tell(stage, share)


def setup(app) -> dict[str, bool]:
    """Called by Sphinx; tutorials and gallery run before the first page is read."""
    read: set[str] = set()

    def reading(app, name: str, _source: list[str]) -> None:
        read.add(name)
        _tell("pages", len(read) / max(len(app.env.found_docs), 1))

    def written(app, name: str, *_: object) -> None:
        read.discard(name)
        _tell("html", 1 - len(read) / max(len(app.env.found_docs), 1))

    app.connect("source-read", reading)
    app.connect("html-page-context", written)
    app.add_config_value("run_in", "", "env")
    app.add_directive("run", Run)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
