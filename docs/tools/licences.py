"""The licences page: its table, from the lock file and what the installed wheels hold.

``python -m docs.tools.licences`` writes the table anew into ``LICENCES.md``; the site is built with the
table of the wheels that it was built with.
"""

import re
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import Distribution, PackageNotFoundError, PackagePath, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "LICENCES.md"
LOCK = ROOT / "requirements-dev.lock"
"""All extras and tools; ``requirements.lock`` is a part of it."""
BEGIN, END = "<!-- made by docs/tools/licences.py -->", "<!-- end of what is made -->"
_SHARED = re.compile(r"(?:^|/)lib([^/]+?)(?:-[0-9a-f]{8})*(?:\.[\d.]+)?(?:\.so(?:\.[\w.]+)?|\.dylib)$|([^/]+)\.dll$")
_MODULE = re.compile(r"\.(?:cpython-[^/]*|abi3|pypy[^/]*|cp\d+-win[^/]*)\.(?:so|dylib)$|\.pyd$")
_NOTICES = re.compile(r"licen[cs]e|copying|notice|copyright|third.?party", re.IGNORECASE)


def locked(lock: Path = LOCK) -> dict[str, str]:
    """Package to the condition it is installed on, "" for always, as a lock file has them."""
    found: dict[str, list[str]] = {}
    for line in lock.read_text(encoding="utf-8").splitlines():
        match = re.match(r"([\w.-]+)==\S+(?: ; ([^\\]*))?", line)
        if match:
            found.setdefault(match[1], []).append((match[2] or "").strip())
    return {name: " or ".join(conditions) if all(conditions) else "" for name, conditions in found.items()}


def licence(found: Distribution) -> str:
    """As the metadata state it: the expression, else the classifiers, else how its text begins."""
    told = found.metadata
    classes = [c.rpartition(":: ")[2] for c in told.get_all("Classifier", []) if c.startswith("License ::")]
    classes = [c for c in classes if c not in ("OSI Approved", "DFSG approved")]
    if stated := told.get("License-Expression") or " and ".join(classes):
        return stated
    texts = [
        told.get("License") or "",
        *(path.read_text(encoding="utf-8") for path in notices(found)),
    ]
    firsts = [next((line.strip("# ") for line in text.splitlines() if line.strip()), "") for text in texts]
    short = next((first for first in firsts if 0 < len(first) < 60), "")
    return short or "see its files"


@lru_cache(maxsize=1)
def paths_of(found: Distribution) -> list[PackagePath]:
    """All files of a wheel."""
    return list(found.files or ())


def bundled(found: Distribution) -> list[str]:
    """Shared libraries of other projects in a wheel, by name; those that are linked into modules cannot be seen."""
    paths = [str(path) for path in paths_of(found)]
    names = {match[1] or match[2] for path in paths if not _MODULE.search(path) and (match := _SHARED.search(path))}
    own = {canonicalize_name(str(found.metadata["Name"])).replace("-", "")}
    return sorted(name for name in names if name.lower().replace("_", "").replace("-", "") not in own)


def notices(found: Distribution) -> list[PackagePath]:
    """Files with licences and notices in a wheel."""
    return [path for path in paths_of(found) if _NOTICES.search(path.name) and ".py" not in path.suffix]


def _needed(lines: Iterable[str], extra: str, seen: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """Adds what these requirements bring here, each with the extra that asks for it."""
    for one in map(Requirement, lines):
        if one.marker is not None and not one.marker.evaluate({"extra": extra}):
            continue
        for more in {(canonicalize_name(one.name), wanted) for wanted in ("", *one.extras)} - seen:
            seen.add(more)
            with suppress(PackageNotFoundError):
                _needed(distribution(more[0]).requires or [], more[1], seen)
    return seen


def parts() -> dict[str, set[str]]:
    """Packages that are needed by "" (the main job) and by each extra beside it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = {"": project["dependencies"], **project["optional-dependencies"]}
    found = {extra: {name for name, _ in _needed(lines, "", set())} for extra, lines in groups.items()}
    return {extra: names - (found[""] if extra else set()) for extra, names in found.items()}


def rows() -> Iterator[Iterable[str]]:
    """Package, what needs it, licence, libraries, files of notices: those of the main job first."""
    needed = parts()
    order = {name: 0 if name in needed[""] else 1 for name in locked()}
    for name, condition in sorted(locked().items(), key=lambda entry: order[entry[0]]):
        extras = [f"`{extra}`" for extra, names in needed.items() if name in names and extra]
        of = "main job" if order[name] == 0 else ", ".join(extras) or "tests, site"
        try:
            found = distribution(name)
        except PackageNotFoundError:
            yield name, of, f"not looked into: only where `{condition}`", "", ""
            continue
        yield f"{name} {found.version}", of, licence(found), ", ".join(bundled(found)) or "-", str(len(notices(found)))


def table() -> str:
    """The table in Markdown."""
    lines = ["| package | needed by | its licence | libraries of others in its wheel | files of notices |"]
    lines += ["|---|---|---|---|---|"]
    return "\n".join(lines + ["| " + " | ".join(c.replace("|", "/") for c in row) + " |" for row in rows()])


def page() -> str:
    """The page, with the table of what is installed."""
    text = PAGE.read_text(encoding="utf-8")
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    return f"{before}{BEGIN}\n\n{table()}\n\n{END}{after}"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
