"""The manifest of a folder: which files of which results mocap wrote there, and where a reader finds them.

A file is ours if the manifest lists it and its content is still what we wrote.
"""

import contextlib
import errno
import hashlib
import json
import os
import re
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from mocap.documents import from_json, open_regular, regular_bytes
from mocap.errors import FormatError, OutputError
from mocap.schema import Entry, Schema, checked, names

MANIFEST = ".mocap-manifest.json"
"""Lists the files of each result in a folder."""
_WHAT = "files that mocap wrote here, with their SHA-256; mocap replaces and removes no other file"
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

    A folder may have come from anywhere: what its manifest says is believed of files below the folder only.

    Raises:
        OutputError: there is something of that name, but no manifest.
    """
    path = folder / MANIFEST
    try:
        found = from_json(regular_bytes(path, follow=False), MANIFEST)
        if not (isinstance(found, dict) and isinstance(found.get("results"), dict)):
            raise FormatError("no results")
        results = {name: _listing(listing) for name, listing in found["results"].items()}
        checked("results", {"names": [*results]}, {"names": names()}, again="")
        pending = found.get("pending")
        return Manifest(results=results, pending=None if pending is None else _pending(pending))
    except FileNotFoundError:
        return Manifest()
    except (FormatError, OSError) as error:
        trouble = error.strerror if isinstance(error, OSError) else str(error).rstrip(": ")
        raise OutputError(
            f"{path} is not a manifest of mocap's results ({trouble}): move it away, or choose another place"
        ) from None


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write the manifest of a folder, whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    handle, name = tempfile.mkstemp(prefix=PARTIAL, suffix=".json", dir=folder)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            plain = {"what": _WHAT, **asdict(manifest)}
            if manifest.pending is None:
                del plain["pending"]
            json.dump(plain, stream, indent=1, sort_keys=True)
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


_FILES: Schema = {"files": names("files"), "sha256": Entry(kind="s", shape=("files",)), "folders": names(needed=False)}
_PENDING: Schema = {"name": Entry(kind="s"), "stage": Entry(kind="s")}
_SHA256 = re.compile("[0-9a-f]{64}")
_STAGE = re.compile(re.escape(PARTIAL) + r"\w+", re.ASCII)


def _pending(found: Any) -> Pending:
    text = checked("pending", found, _PENDING, again="")
    if not _STAGE.fullmatch(text["stage"][()]):
        raise FormatError(f"pending: stage is {text['stage'][()]!r}, expected a folder {PARTIAL}...")
    replaces = _listing({"files": found.get("replaces"), "folders": []}).files
    new = _listing(found.get("new"))
    return Pending(name=text["name"][()], stage=text["stage"][()], new=new, replaces=replaces)


def _listing(found: Any) -> Listing:
    files = found.get("files") if isinstance(found, dict) else None
    if not isinstance(files, dict):
        raise FormatError("files are no table of names with their SHA-256")
    parts = {"files": [*files], "sha256": [*files.values()], "folders": found.get("folders", [])}
    listed = checked("files", parts, _FILES, again="")
    wrong = [file for file in (*listed["files"], *listed["folders"]) if not is_below(file)]
    wrong += [file for file, content in files.items() if not _SHA256.fullmatch(content)]
    if wrong:
        raise FormatError(f"files: {wrong[0]!r} is no file below the folder with its SHA-256")
    return Listing(files=dict(files), folders=tuple(listed["folders"]))


def is_below(file: str) -> bool:
    r"""Whether a path, as we write it, leads below its folder on every system.

    It has slashes, and no ``..``, no drive and no ``\\``, and is none of the files by which mocap works.
    """
    parts = file.split("/")
    return not re.match("[A-Za-z]:", file) and all(
        part and part.rstrip(". ") == part and "\\" not in part and not part.casefold().startswith(".mocap-")
        for part in parts
    )


def is_inside(folder: Path, file: str) -> bool:
    """Whether nothing on the way to a path below a folder, itself included, is a link (or a junction of Windows)."""
    place = os.fspath(folder)
    for part in file.split("/"):
        place = os.path.join(place, part)
        if os.path.islink(place) or getattr(os.path, "isjunction", os.path.islink)(place):
            return False
    return True


def current(folder: Path, file: str) -> Path:
    """Where a file of a result is: at its place, or in the hidden folder of a run that was interrupted while moving."""
    return current_files(folder).get(file, folder / file)


def current_files(folder: Path) -> dict[str, Path]:
    """Where each file of the results in a folder is, by its path below it; without a manifest all files there are."""
    try:
        manifest = read_manifest(folder)
    except OutputError:
        manifest = Manifest()
    if not manifest.results and manifest.pending is None:
        found = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if path.is_file()}
        return {file: path for file, path in found.items() if is_inside(folder, file)}
    where = {file: file for listing in manifest.results.values() for file in listing.files}
    if manifest.pending is not None:
        stage = manifest.pending.stage
        where = {file: place for file, place in where.items() if file not in manifest.pending.replaces}
        for file in manifest.pending.new.files:
            staged = is_inside(folder, stage) and (folder / stage / file).is_file()
            where[file] = f"{stage}/{file}" if staged else file
    return {file: folder / place for file, place in where.items() if is_inside(folder, place)}


@contextlib.contextmanager
def place_of(folder: Path, file: str, *, make: bool = False) -> Iterator[tuple[int | None, str]]:
    """The folder that a file below a folder (which may be a link) is in, opened, and the file's name there.

    No link is followed on the way, whoever puts one there meanwhile; a system that opens no folders (Windows) is asked
    before, and gets the whole path. Folders on the way are made where ``make`` says so.

    Raises:
        OutputError: there is a link on the way.
        FileNotFoundError: a folder on the way is missing.
    """
    *above, name = file.split("/")
    if os.open not in os.supports_dir_fd:
        for i in range(len(above)):
            if not is_inside(folder, "/".join(above[: i + 1])):
                raise _leads_out(folder, file)
        if make:
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
        yield None, str(folder / file)
        return
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        for part in above:
            if make:
                with contextlib.suppress(FileExistsError):
                    os.mkdir(part, dir_fd=handle)
            try:
                below = os.open(part, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=handle)
            except OSError as error:
                raise (_leads_out(folder, file) if error.errno in (errno.ELOOP, errno.ENOTDIR) else error) from None
            os.close(handle)
            handle = below
        yield handle, name
    finally:
        os.close(handle)


def _leads_out(folder: Path, file: str) -> OutputError:
    return OutputError(
        f"{folder}: {file} leads through a link, which mocap does not follow below a result's folder: put a folder in "
        "its place, or choose another place"
    )


def digest(path: Path) -> str:
    """SHA-256 of a file's content."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def is_still(path: Path | str, content: str, *, within: int | None = None) -> bool:
    """Whether a path, or name in an opened folder (``place_of``), is a plain file (no link) with that SHA-256."""
    try:
        with open_regular(path, within=within) as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest() == content  # type: ignore[arg-type]
    except (FormatError, FileNotFoundError):
        return False
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENXIO, errno.ENOTDIR, errno.EISDIR):
            return False
        raise


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


LOCK = ".mocap-lock"
"""File that holds a folder on Windows while a process writes there; elsewhere the folder itself is locked."""


@contextlib.contextmanager
def locked(folder: Path, *, patience_s: float = 0.0) -> Iterator[None]:
    """Hold a folder against other processes of ours, which are waited for so long; the lock ends with the process.

    Raises:
        OutputError: another process holds it.
    """
    handle = _lock(folder, patience_s)
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)


OPEN = ".mocap-open"
"""File that holds a folder for a program that works in it for hours, while results are still written there."""


@contextlib.contextmanager
def occupied(folder: Path, by: str) -> Iterator[None]:
    """Hold a folder against other programs of the same kind; that ends with the process, however it ends.

    Args:
        folder: The folder; one that is not there is made, and goes again where nothing was put there.
        by: What works in it, as ``a desk``.

    Raises:
        OutputError: another one works there, or nothing can be written there.
    """
    path, made = folder / OPEN, not folder.is_dir()
    handle = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        while handle is None:
            handle = _hold(path, by)
        yield
    except OSError as error:
        if handle is not None:
            raise
        raise OutputError(f"{folder}: cannot be written: {error.strerror}: choose another place") from None
    finally:
        if handle is not None:
            with contextlib.suppress(OSError):  # on Windows it stays; what holds the folder is the lock
                path.unlink()
            os.close(handle)
            if made:
                with contextlib.suppress(OSError):
                    folder.rmdir()


def _hold(path: Path, by: str) -> int | None:
    """A handle of the file that holds a folder; None: the one who had it removed it meanwhile."""
    handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.exists(path) and os.path.samestat(os.fstat(handle), os.stat(path)):
            return handle
    except OSError as error:
        if error.errno in _NO_LOCKS:
            return handle
        os.close(handle)
        if error.errno in (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK):
            raise OutputError(
                f"{path.parent}: {by} is open there already: go on in its page, or end it, or choose another place"
            ) from None
        raise
    os.close(handle)
    return None


_NO_LOCKS = (errno.EBADF, errno.EINVAL, errno.ENOLCK, errno.ENOTSUP)
"""Of network file systems that know no locks."""


def _lock(folder: Path, patience_s: float) -> int | None:
    """A handle that holds the lock; None where the file system knows no locks."""
    end = time.monotonic() + patience_s
    while True:
        handle = None
        try:
            if sys.platform == "win32":
                import msvcrt

                handle = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_TEMPORARY)
                msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                handle = os.open(folder, os.O_RDONLY)
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return handle
        except OSError as error:
            if handle is not None:
                os.close(handle)
            if error.errno in _NO_LOCKS:
                return None  # some network file systems lock no folders
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK):
                raise
            if handle is None:  # it could not even be opened
                raise
            if time.monotonic() >= end:
                raise OutputError(
                    f"{folder}: another mocap is writing there: wait until it has ended, or choose another place"
                ) from None
            time.sleep(0.05)
