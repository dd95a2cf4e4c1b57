"""Result folders that came from elsewhere: what their manifests ask for must not reach anything outside of them.

Every place of a manifest that holds a path gets every kind of path that leads out, every hidden folder that it may name
is made in every wrong way, and the manifest itself is everything but a manifest. Then a result is written there. A case
is a defect where something outside was touched, an error is no ``OutputError``, or it does not come to an end.
"""

import argparse
import hashlib
import json
import os
import signal
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mocap.errors import OutputError
from mocap.io.manifest import MANIFEST, PARTIAL, current_files
from mocap.io.output import result_file, result_folder

Case = Callable[[Path, Path], None]
"""Makes a foreign folder, given that and the folder beside it that must stay as it is."""
SECONDS = 20
STAGE = f"{PARTIAL}abc"
KNOWN = b"MIT known text\n"
SHA256 = hashlib.sha256(KNOWN).hexdigest()
PATHS = {
    "up": "../victim/LICENSE",
    "absolute": "{victim}/LICENSE",
    "down and up": "sub/../../victim/LICENSE",
    "backslashes": "..\\victim\\LICENSE",
    "drive": "C:\\victim\\LICENSE",
    "drive without a slash": "C:LICENSE",
    "share": "\\\\server\\victim\\LICENSE",
    "two slashes": "//victim/LICENSE",
    "dot": "./../victim/LICENSE",
    "nothing": "",
    "the folder itself": ".",
    "its parent": "..",
    "trailing dots": ".. /victim/LICENSE",
    "linked folder": "link/LICENSE",
    "linked folder in a folder": "sub/link/LICENSE",
    "link": "LICENSE.link",
    "manifest": MANIFEST,
    "lock": ".mocap-lock",
    "lock in capitals": ".MOCAP-LOCK",
    "hidden folder": f"{STAGE}/LICENSE",
    "NUL": "../victim\0/LICENSE",
    "too long": "../victim/" + "x" * 5000,
}
PLACES = ("files", "folders", "new files", "new folders", "replaces")
STAGES = {
    "link": STAGE,
    "up": "../victim",
    "absolute": "{victim}",
    "nested": f"sub/{STAGE}",
    "nested in a link": f"{STAGE}/link",
    "another folder": "sub",
    "the folder itself": ".",
    "with a line end": f"{STAGE}\n",
    "other letters": f"{PARTIAL}\u0430\u0431",
}
WHOLE: dict[str, Any] = {
    "list": [],
    "text": "results",
    "number": 1,
    "nothing": None,
    "results a list": {"results": []},
    "results a text": {"results": "track"},
    "a result a list": {"results": {"track": []}},
    "files a list": {"results": {"track": {"files": ["a"]}}},
    "a SHA-256 a number": {"results": {"track": {"files": {"a": 1}}}},
    "a SHA-256 too short": {"results": {"track": {"files": {"a": "00"}}}},
    "a SHA-256 nothing": {"results": {"track": {"files": {"a": None}}}},
    "folders a table": {"results": {"track": {"files": {}, "folders": {}}}},
    "a folder a number": {"results": {"track": {"files": {}, "folders": [1]}}},
    "pending a list": {"results": {}, "pending": []},
    "pending empty": {"results": {}, "pending": {}},
    "stage a number": {"results": {}, "pending": {"name": "x", "stage": 1, "new": {"files": {}}, "replaces": {}}},
    "new nothing": {"results": {}, "pending": {"name": "x", "stage": STAGE, "new": None, "replaces": {}}},
    "replaces a list": {"results": {}, "pending": {"name": "x", "stage": STAGE, "new": {"files": {}}, "replaces": []}},
    "many files": {"results": {"track": {"files": {f"f{i}": SHA256 for i in range(20_000)}}}},
}


def written(found: Any) -> Case:
    """A manifest of that content."""

    def make(folder: Path, victim: Path) -> None:
        text = json.dumps(found).replace("{victim}", victim.as_posix())
        (folder / MANIFEST).write_text(text, encoding="utf-8")

    return make


def of_path(place: str, path: str) -> Case:
    """A manifest with a path in one of its places, and in its hidden folder a file of that name where one can be."""
    listing = {"files": {path: SHA256} if place == "files" else {}, "folders": [path] if place == "folders" else []}
    new = {"files": {path: SHA256} if place == "new files" else {}, "folders": [path] if place == "new folders" else []}
    pending = {"name": "x", "stage": STAGE, "new": new, "replaces": {path: SHA256} if place == "replaces" else {}}
    whole = {"results": {"track": listing, "x": listing if place == "folders" else {"files": {}}}, "pending": pending}

    def make(folder: Path, victim: Path) -> None:
        (folder / "sub").mkdir()
        for link in ("link", "sub/link"):
            (folder / link).symlink_to(victim)
        (folder / "LICENSE.link").symlink_to(victim / "LICENSE")
        staged = folder / STAGE / path
        if place == "new files" and not path.startswith(("/", "{", ".")) and ".." not in path:
            staged.parent.mkdir(parents=True, exist_ok=True)
            staged.write_bytes(KNOWN)
        written(whole)(folder, victim)

    return make


def of_stage(stage: str, *, link: bool) -> Case:
    """A pending result in a hidden folder that is none of ours, with a file that is really there."""
    pending = {"name": "x", "stage": stage, "new": {"files": {"LICENSE": SHA256}}, "replaces": {}}

    def make(folder: Path, victim: Path) -> None:
        (folder / "sub").mkdir()
        if link:
            (folder / STAGE).symlink_to(victim)
        else:
            (folder / STAGE).mkdir()
            (folder / STAGE / "link").symlink_to(victim)
        written({"results": {}, "pending": pending})(folder, victim)

    return make


def staged(content: Callable[[Path, Path], None], *, file: str = "LICENSE") -> Case:
    """A pending result whose hidden folder is ours, with something else than the listed file in it."""
    pending = {"name": "x", "stage": STAGE, "new": {"files": {file: SHA256}}, "replaces": {}}

    def make(folder: Path, victim: Path) -> None:
        (folder / STAGE).mkdir()
        content(folder / STAGE, victim)
        written({"results": {}, "pending": pending})(folder, victim)

    return make


def _as_file(text: str) -> Case:
    return lambda folder, _: (folder / MANIFEST).write_text(text, encoding="utf-8") and None


CASES: Mapping[str, Case] = {
    **{f"{place}: {name}": of_path(place, path) for place in PLACES for name, path in PATHS.items()},
    **{f"hidden folder: {name}": of_stage(stage, link=name == "link") for name, stage in STAGES.items()},
    "hidden folder: a file": lambda folder, victim: (
        written({"results": {}, "pending": {"name": "x", "stage": STAGE, "new": {"files": {"a": SHA256}},
                 "replaces": {}}})(folder, victim),
        (folder / STAGE).write_bytes(KNOWN),
    )[0],
    "staged: another file": staged(lambda stage, _: (stage / "LICENSE").write_bytes(b"other") and None),
    "staged: a link": staged(lambda stage, victim: (stage / "LICENSE").symlink_to(victim / "LICENSE")),
    "staged: a pipe": staged(lambda stage, _: os.mkfifo(stage / "LICENSE")),
    "staged: a folder": staged(lambda stage, _: (stage / "LICENSE").mkdir()),
    "staged: in a linked folder": staged(lambda stage, victim: (stage / "s").symlink_to(victim), file="s/LICENSE"),
    "target: in a linked folder": lambda folder, victim: (
        staged(lambda stage, _: ((stage / "s").mkdir(), (stage / "s" / "new").write_bytes(KNOWN))[0],
               file="s/new")(folder, victim),
        (folder / "s").symlink_to(victim),
    )[0],
    **{f"manifest: {name}": written(found) for name, found in WHOLE.items()},
    "manifest: nested lists": _as_file("[" * 100_000 + "]" * 100_000),
    "manifest: nested tables": _as_file('{"results":' * 50_000 + "1" + "}" * 50_000),
    "manifest: a number of 100,000 digits": _as_file('{"results": ' + "9" * 100_000 + "}"),
    "manifest: cut": _as_file('{"results": {"track"'),
    "manifest: empty": _as_file(""),
    "manifest: half a character": _as_file('{"results": {"\\ud800": {"files": {}}}}'),
    "manifest: a folder": lambda folder, _: (folder / MANIFEST).mkdir(),
    "manifest: a pipe": lambda folder, _: os.mkfifo(folder / MANIFEST),
    "manifest: a device": lambda folder, _: (folder / MANIFEST).symlink_to("/dev/zero"),
    "manifest: a link": lambda folder, victim: (folder / MANIFEST).symlink_to(victim / "LICENSE"),
    "manifest: 100 MB": _as_file(" " * 100_000_000),
}  # fmt: skip
"""What a foreign folder holds, by name."""


def snapshot(folder: Path) -> dict[str, object]:
    """All that lies in a folder: content, kind and time of change of each file, by its path."""
    found: dict[str, object] = {}
    for path in sorted(folder.rglob("*")):
        stat = path.lstat()
        found[path.relative_to(folder).as_posix()] = (stat.st_mode, stat.st_mtime_ns, path.read_bytes())
    return found


def _stop(_number: int, _frame: object) -> None:
    raise TimeoutError(f"no end after {SECONDS} s")


def attacked(case: Case, root: Path, *, one_file: bool) -> str:
    """Make a case below an empty folder, write a result into it, and say what came: ``refused`` or ``written``.

    Raises:
        AssertionError: something outside was touched, or what is read as the folder's is outside of it.
        Exception: whatever came that is no ``OutputError``.
    """
    folder, victim = root / "dl", root / "victim"
    folder.mkdir()
    victim.mkdir()
    (victim / "LICENSE").write_bytes(KNOWN)
    (victim / "empty.txt").touch()
    case(folder, victim)
    before = snapshot(victim)
    earlier = signal.signal(signal.SIGALRM, _stop)
    signal.alarm(SECONDS)
    try:
        inside = os.path.join(os.path.realpath(folder), "")
        outside = [path for path in current_files(folder).values() if not os.path.realpath(path).startswith(inside)]
        if one_file:
            with result_file(folder / "o.trc", replace=True) as file:
                file.write_text("new")
        else:
            with result_folder(folder, "track", replace=True) as stage:
                (stage / "link").mkdir()
                (stage / "link" / "o.trc").write_text("new")
        verdict = "written"
    except OutputError as error:
        verdict = "refused" if "\n" not in str(error) else "several lines"
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, earlier)
    if outside or snapshot(victim) != before:
        raise AssertionError(f"touched outside: {outside or sorted(snapshot(victim).items() ^ before.items())}")
    return verdict


def run(_options: argparse.Namespace) -> int:
    """Attack with every case, into a file and into a folder; the number of defects."""
    counts: dict[str, Counter[str]] = {}
    defects = 0
    for name, case in CASES.items():
        for one_file in (True, False):
            with tempfile.TemporaryDirectory() as root:
                try:
                    verdict = attacked(case, Path(root), one_file=one_file)
                except Exception as error:
                    verdict, defects = "defect", defects + 1
                    print(f"foreign, {name}, {'file' if one_file else 'folder'}: {type(error).__name__}: {error}"[:300])
            counts.setdefault(name.partition(":")[0], Counter())[verdict] += 1
    print(f"{'foreign folders':<16}  cases  refused  written  defects")
    for kind, count in counts.items():
        print(f"{kind:<16}  {count.total():5}  {count['refused']:7}  {count['written']:7}  {count['defect']:7}")
    print(f"{2 * len(CASES)} foreign folders: {defects} defects")
    return defects
