"""The page "The house in ten minutes", made from the code: rooms, parts of the record, the way of a sample.

Nothing of it is written down: a room that is moved, a part that is added or a step that goes another way is on the page
with the next build.
"""

import ast
import sys
from collections.abc import Callable, Mapping
from functools import cache
from graphlib import TopologicalSorter
from html import escape
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).parents[2]
TOPS = ("mocap", "eal", "filters", "datasets")
MAPPED = {"mocap.filters": "filters", "mocap.datasets": "datasets"}
"""Folders at the top and the names that they are imported by."""
WIDTH, ROW, BOX, GAP = 860, 66, 44, 12
SCALE = {"verb": "#0072b2", "satellite": "#d55e00", "ground": "#222222"}


def room(path: str) -> str:
    """The room of a file, as ``mocap/io``; files of ``mocap/`` itself are the ground, ``mocap``."""
    parts = path.split("/")
    return "/".join(parts[:2]) if parts[0] == "mocap" and len(parts) > 2 else parts[0]


@cache
def files() -> dict[str, str]:
    """Every source file of the four packages."""
    found = (path for top in TOPS for path in sorted((ROOT / top).rglob("*.py")))
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in found}


def _path(module: str) -> str | None:
    """The file of a module of ours by its dotted name, or by that of something in it."""
    for name, folder in MAPPED.items():
        if module == name or module.startswith(f"{name}."):
            module = folder + module.removeprefix(name)
    parts = module.split(".")
    for some in (parts, parts[:-1]):
        for path in ("/".join(some) + ".py", "/".join([*some, "__init__.py"])):
            if path in files():
                return path
    return None


@cache
def imported() -> dict[str, frozenset[str]]:
    """Which other rooms the files of each room import; the file of public names, which imports when asked, left out."""
    found: dict[str, set[str]] = {room(path): set() for path in files()}
    for path, source in files().items():
        if path == "mocap/__init__.py":
            continue
        for node in ast.walk(ast.parse(source)):
            names = [one.name for one in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names = [f"{node.module}.{one.name}" for one in node.names]
            targets = {room(target) for name in names if (target := _path(name)) is not None}
            found[room(path)] |= targets - {room(path)}
    return {name: frozenset(others) for name, others in found.items()}


def floors() -> list[list[str]]:
    """Rooms from the ground up: each imports only what lies on floors below it."""
    # the record knows cameras and all else knows the record: a circle of folders, not of files, cut at the ground
    graph = {name: set(others) for name, others in imported().items()}
    graph["mocap"] = {other for other in graph["mocap"] if not other.startswith("mocap/")}
    floor: dict[str, int] = {}
    for name in TopologicalSorter(graph).static_order():
        floor[name] = 1 + max((floor[other] for other in graph[name]), default=-1)
    return [sorted(name for name, at in floor.items() if at == level) for level in range(max(floor.values()) + 1)]


@cache
def satellites() -> frozenset[str]:
    """Rooms that the rest does without."""
    from mocap.cli.table import SATELLITES

    return frozenset(name.replace(".", "/") for one in SATELLITES.values() for name in one.packages)


def lines(name: str) -> int:
    """Of all files of a room."""
    return sum(source.count("\n") for path, source in files().items() if room(path) == name)


def first_sentence(name: str) -> str:
    """What a room says of itself."""
    source = files().get(f"{name}/__init__.py", "")
    told = (ast.get_docstring(ast.parse(source)) or "").partition("\n\n")[0]
    return " ".join(told.split()).replace("``", "`")


def drawn() -> str:
    """The picture: floors from the top down, satellites dashed, with the lines of each room."""
    rows = list(reversed(floors()))
    height = ROW * len(rows) + GAP
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" role="img" '
        'aria-label="Rooms; each imports only from rows below it" font-family="sans-serif" font-size="13">'
    ]
    for i, names in enumerate(rows):
        width = (WIDTH - GAP) / len(names) - GAP
        for k, name in enumerate(names):
            x, y = GAP + k * (width + GAP), GAP + i * ROW
            dash = ' stroke-dasharray="6 4"' if name in satellites() else ""
            colour = SCALE["satellite" if name in satellites() else "ground" if "/" not in name else "verb"]
            out.append(
                f'<rect x="{x:.1f}" y="{y}" width="{width:.1f}" height="{BOX}" rx="6" fill="none" stroke="{colour}" '
                f'stroke-width="1.5"{dash}/><text x="{x + width / 2:.1f}" y="{y + 18}" text-anchor="middle" '
                f'fill="currentColor">{escape(name.removeprefix("mocap/"))}</text>'
                f'<text x="{x + width / 2:.1f}" y="{y + 35}" text-anchor="middle" fill="currentColor" font-size="11">'
                f"{lines(name):,} lines</text>"
            )
    return "\n".join([*out, "</svg>"])


def parts() -> list[tuple[str, str, str, str]]:
    """Name in files, class, step and first sentence of each part that a recording keeps."""
    from mocap.results.stored import PARTS

    return [
        (name, f"{kind.__module__}.{kind.__name__}", kind.step, _sentence(kind))  # type: ignore[attr-defined]
        for name, kind in PARTS.items()
    ]


def _sentence(of: Any) -> str:
    """The first sentence of a docstring."""
    return " ".join((of.__doc__ or "").partition("\n\n")[0].split()).replace("``", "`").replace("|", "\\|")


DEPTHS = {"read": 1, "clean": 1, "track": 3}
"""Of calls below each verb that are shown."""


def way(run: Callable[[], object], most: int) -> list[tuple[int, str, str]]:
    """The functions that a call enters, in order, each once, down to a depth: how deep, name, first sentence."""
    known = {str(ROOT / path) for path in files()}
    stack: list[bool] = []  # of all frames of ours: whether it is one that counts
    seen: dict[str, tuple[int, str, str]] = {}

    def entered(frame: FrameType, event: str, _: object) -> None:
        if event not in ("call", "return") or frame.f_code.co_filename not in known:
            return
        if event == "return":
            if stack:
                stack.pop()
            return
        name, depth = frame.f_code.co_name, sum(stack)
        found = None if name.startswith(("_", "<")) else frame.f_globals.get(name)
        counts = found is not None and callable(found) and bool(found.__doc__)
        stack.append(counts)
        if counts and depth <= most:
            full = f"{found.__module__}.{name}"
            seen.setdefault(full, (depth, full, _sentence(found)))

    before = sys.getprofile()
    sys.setprofile(entered)
    try:
        run()
    finally:
        sys.setprofile(before)
    return list(seen.values())


def steps(folder: Path) -> dict[str, list[tuple[int, str, str]]]:
    """The way of a small recording through the three verbs, the second time: the first one imports."""
    mocap, datasets = import_module("mocap"), import_module("mocap.datasets")
    made = datasets.make_lizard(seed=0, n_frames=40)
    written = datasets.write_recording(made, folder)
    given = {"calibration": written["coefficients"], "profile": written["profile"], "skeleton": written["skeleton"]}
    kept: list[Any] = []
    verbs: dict[str, Callable[[], object]] = {
        "read": lambda: kept.append(mocap.read(written["pixels"], fps=made.fps, **given)),
        "clean": lambda: kept.append(mocap.clean(kept[-1])),
        "track": lambda: kept.append(mocap.track(kept[-1], model="eal", validate=False, progress=lambda *_: None)),
    }
    for verb in verbs.values():
        verb()
    return {name: way(verb, DEPTHS[name]) for name, verb in verbs.items()}


def added() -> Mapping[str, list[str]]:
    """Variables of the record by the step that adds them."""
    from mocap.variables import VARIABLES

    out: dict[str, list[str]] = {}
    for name, told in VARIABLES.items():
        out.setdefault(told.since, []).append(f"`{name}`")
    return out


HEAD = """# The house in ten minutes

For who changes the code. All of this page is made from the code when the site is built.

## Rooms

Each room imports only from rows below it; dashed rooms are satellites, which the rest does without. Black: the packages
at the top of the repository. `mocap` is the ground: record, skeleton, findings, errors, with cameras, which the record
knows.
`filters/` is installed as `mocap.filters`, `datasets/` as `mocap.datasets`.

"""


PARTS_SAY = (
    "Arrays are variables of one Dataset ([the record](record.md)). What no array holds is in parts, each of its step:"
)
WAY_SAYS = (
    "The built-in lizard, 40 frames, as it was traced with the model `eal`: public functions, each where it is first "
    "called."
)


def page() -> str:
    """The page, in Markdown."""
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        ways = steps(Path(folder))
    out = [HEAD, "```{raw} html", drawn(), "```", "", "| room | lines | what it says of itself |", "|---|---|---|"]
    names = [name for level in reversed(floors()) for name in level]
    out += [f"| `{name}` | {lines(name):,} | {first_sentence(name)} |" for name in names]
    out += ["", "## Parts of the record", "", PARTS_SAY, "", "| part | class | step | |", "|---|---|---|---|"]
    out += [f"| `{name}` | `{kind}` | `{step}` | {told} |" for name, kind, step, told in parts()]
    out += ["", "## The way of a sample", "", WAY_SAYS, ""]
    variables = added()
    for verb, calls in ways.items():
        out += [f"### {verb}", "", f"It adds {', '.join(variables.get(verb, ()))}.", ""]
        out += [f"{'  ' * depth}- `{name}`: {told}" for depth, name, told in calls] + [""]
    out += ["Where to add what: [extending](../howto/extend.md). How a change is made: `CONTRIBUTING.md`."]
    return "\n".join(out) + "\n"


if __name__ == "__main__":
    sys.stdout.write(page())
