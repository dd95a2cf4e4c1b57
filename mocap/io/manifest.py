"""The manifest of a folder: which files of which results mocap wrote there, and where a reader finds them.

A file is ours if the manifest lists it and its content is still what we wrote.
"""

import contextlib
import hashlib
import json
import os
import re
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from mocap.errors import OutputError

MANIFEST = ".mocap-manifest.json"
"""Lists the files of each result in a folder."""
PARTIAL = ".mocap-partial-"
"""How the name of a hidden folder begins in which a result is written."""


@dataclass(frozen=True, kw_only=True)
class Listing:
    """The files of a result.

    Attributes:
        files: SHA-256 by path below the folder, with slashes.
        folders: Folders that were made for them.
    """

    files: Mapping[str, str] = field(default_factory=dict)
    folders: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Pending:
    """A result that counts, but of which some files are still in their hidden folder.

    Attributes:
        name: Of the result.
        stage: The hidden folder.
        new: Its files.
        replaces: SHA-256 of the files that these replace, or that have to go.
    """

    name: str
    stage: str
    new: Listing
    replaces: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """All results in a folder, by name, and the one that is not yet at its place."""

    results: Mapping[str, Listing] = field(default_factory=dict)
    pending: Pending | None = None

    def owner(self, file: str) -> str | None:
        """Name of the result that a file belongs to."""
        return next((name for name, listing in self.results.items() if file in listing.files), None)


def read_manifest(folder: Path) -> Manifest:
    """The manifest of a folder; an empty one where there is none.

    Raises:
        OutputError: there is a file of that name, but no manifest.
    """
    path = folder / MANIFEST
    try:
        found = json.loads(path.read_bytes())
        pending = found.get("pending")
        if pending is not None and not re.fullmatch(re.escape(PARTIAL) + r"\w+", pending["stage"]):
            raise ValueError("a hidden folder of another name")
        return Manifest(
            results={name: _listing(listing) for name, listing in found["results"].items()},
            pending=None
            if pending is None
            else Pending(
                name=str(pending["name"]),
                stage=str(pending["stage"]),
                new=_listing(pending["new"]),
                replaces=dict(pending["replaces"]),
            ),
        )
    except FileNotFoundError:
        return Manifest()
    except (ValueError, KeyError, TypeError, AttributeError):
        raise OutputError(
            f"{path} is not a manifest of mocap's results: move it away, or choose another place"
        ) from None


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write the manifest of a folder, whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    handle, name = tempfile.mkstemp(prefix=PARTIAL, suffix=".json", dir=folder)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            json.dump(_plain(manifest), stream, indent=1, sort_keys=True)
            stream.write("\n")
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(name, 0o644)
        os.replace(name, folder / MANIFEST)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise
    sync_folder(folder)


def _plain(manifest: Manifest) -> dict[str, object]:
    plain: dict[str, object] = {
        "what": "files that mocap wrote here, with their SHA-256; mocap replaces and removes no other file",
        "results": {name: _plain_listing(listing) for name, listing in manifest.results.items()},
    }
    pending = manifest.pending
    if pending is not None:
        new = _plain_listing(pending.new)
        plain["pending"] = {
            "name": pending.name, "stage": pending.stage, "new": new, "replaces": dict(pending.replaces)
        }  # fmt: skip
    return plain


def _plain_listing(listing: Listing) -> dict[str, object]:
    return {"files": dict(listing.files), "folders": list(listing.folders)}


def _listing(found: Mapping[str, object]) -> Listing:
    files, folders = found["files"], found.get("folders", [])
    if not (isinstance(files, dict) and isinstance(folders, list)):
        raise TypeError("files and folders")
    if any(Path(path).is_absolute() or ".." in Path(path).parts for path in [*files, *folders]):
        raise ValueError("a path that leads out of the folder")
    return Listing(files={str(f): str(c) for f, c in files.items()}, folders=tuple(map(str, folders)))


def current(folder: Path, file: str) -> Path:
    """Where a file of a result is: at its place, or in the hidden folder of a run that was interrupted while moving.

    Args:
        folder: The result's folder.
        file: Path below it, with slashes.
    """
    return current_files(folder).get(file, folder / file)


def current_files(folder: Path) -> dict[str, Path]:
    """Where each file of the results in a folder is, by its path below it; without a manifest all files there are."""
    try:
        manifest = read_manifest(folder)
    except OutputError:
        manifest = Manifest()
    if not manifest.results and manifest.pending is None:
        return {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if path.is_file()}
    where = {file: folder / file for listing in manifest.results.values() for file in listing.files}
    if manifest.pending is not None:
        stage = folder / manifest.pending.stage
        where = {file: path for file, path in where.items() if file not in manifest.pending.replaces}
        for file in manifest.pending.new.files:
            where[file] = stage / file if (stage / file).is_file() else folder / file
    return where


def digest(path: Path) -> str:
    """SHA-256 of a file's content."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def is_still(path: Path, content: str) -> bool:
    """Whether a path is a plain file with that SHA-256."""
    return path.is_file() and not path.is_symlink() and digest(path) == content


def sync_folder(folder: Path) -> None:
    """Bring the names in a folder to the disk, where the system can."""
    if sys.platform == "win32":
        return
    with contextlib.suppress(OSError):  # many file systems have no such thing
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
