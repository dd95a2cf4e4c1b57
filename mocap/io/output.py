"""Results on disk: the one way in which every command writes, so that nothing of anybody is ever lost.

A result is one or several files in a folder. They are written into a hidden folder there, ``.mocap-partial-*``, brought
to the disk, and listed in ``.mocap-manifest.json`` with their SHA-256: that is the moment from which the new
result counts. Then each is renamed to its place, over a file of the earlier result only, and the manifest is written
once more without the list of what is to be moved. Whatever comes between (a kill, a full disk, an error), the earlier
result or the new one is whole: ``current`` finds its files, and the next command that writes there finishes or removes
what was left, and says so.

A file is ours if the manifest lists it and its content is still what we wrote. No other file is ever replaced, moved or
removed, whatever is asked.
"""

import contextlib
import dataclasses
import errno
import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from mocap.errors import OutputError, shown_elsewhere
from mocap.io.manifest import (
    LOCK,
    MANIFEST,
    PARTIAL,
    Listing,
    Manifest,
    Pending,
    digest,
    is_below,
    is_inside,
    is_still,
    locked,
    place_of,
    read_manifest,
    sync_folder,
    write_manifest,
)

PATIENCE_S = 10.0
"""So long a file waits for another process that is writing beside it; a folder does not wait."""

Tell = Callable[[str], None]


def silent(line: str) -> None:
    """Tell nobody."""


@contextlib.contextmanager
def result_folder(
    folder: Path,
    name: str,
    *,
    replace: bool = False,
    beside: bool = False,
    inputs: Iterable[Path | None] = (),
    tell: Tell = silent,
) -> Iterator[Path]:
    """Write a result of several files into a folder; all of them appear, or none.

    The folder may be new, a link, or a mount point, and may hold anything else. While the result is made no other
    process can write a result there.

    Args:
        folder: Where to.
        name: Of the result in the folder's manifest, as ``track``; an earlier result of this name is replaced.
        replace: Whether that may be, and whether a folder may hold other files, which stay untouched.
        beside: Whether the folder may hold other files in any case.
        inputs: Files that are read, which are never written over; None is skipped.
        tell: Told of what an interrupted run had left.

    Yields:
        An empty folder to write the files into, at the paths that they shall have.

    Raises:
        OutputError: the folder cannot be written, is in use, holds an earlier result that may not be replaced, or a
            file that is not ours where one of the result's would go. Nothing there has been changed then.
    """
    _refuse_inputs(folder, inputs, folder=not beside)
    made = _make_folder(folder)
    try:
        with _answering(folder), locked(folder):
            manifest = recovered(folder, tell=tell)
            _refuse_unasked(folder, name, manifest, replace=replace, beside=beside)
            with _stage(folder) as stage:
                yield stage
                _commit(folder, stage, name, inputs=inputs, take_over=False)
    finally:
        _remove_empty(made)


@contextlib.contextmanager
def result_file(
    path: Path, *, replace: bool = False, inputs: Iterable[Path | None] = (), tell: Tell = silent
) -> Iterator[Path]:
    """Write a file, or several of which ``path`` is the first; all of them appear, or none.

    Args:
        path: The file; a link is followed.
        replace: Whether an earlier file of ours may be replaced.
        inputs: Files that are read, which are never written over; None is skipped.
        tell: Told of what an interrupted run had left.

    Yields:
        A path of the same name in an empty folder; further files beside it belong to the result.

    Raises:
        OutputError: it cannot be written there, exists and may not be replaced, or exists and is not ours. Nothing
            there has been changed then.
    """
    _refuse_inputs(path, inputs, folder=False)
    if path.is_dir():
        raise OutputError(f"{path} is a folder: give a file to write")
    target = path.resolve()
    made = _make_folder(target.parent)
    try:
        with contextlib.ExitStack() as stack:
            stack.enter_context(_answering(path))
            with locked(target.parent, patience_s=PATIENCE_S):
                manifest = recovered(target.parent, tell=tell)
                if os.path.lexists(target):
                    if not replace:
                        raise OutputError(f"{path} exists: give `overwrite` to replace it, or another name")
                    _refuse_foreign(target.parent, target.name, manifest)
                stage = stack.enter_context(_stage(target.parent))
            yield stage / target.name
            with locked(target.parent, patience_s=PATIENCE_S):
                _commit(target.parent, stage, target.name, inputs=inputs, take_over=True, may_replace=replace)
    finally:
        _remove_empty(made)


def recovered(folder: Path, *, tell: Tell = silent) -> Manifest:
    """Finish what an interrupted run had decided, and remove what it had not; the caller holds the folder's lock.

    Raises:
        OutputError: a file that would be replaced was changed since.
    """
    manifest = read_manifest(folder)
    if manifest.pending is not None:
        manifest = _finish(folder, manifest)
        tell(f"{folder}: an earlier run was interrupted while its files were renamed: its result is now complete")
    left = [path for path in sorted(folder.glob(f"{PARTIAL}*")) if not path.is_symlink()]
    removed = [path for path in left if _abandoned(path)]
    for path in removed:
        shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
    if any(path.suffix != ".json" for path in removed):
        tell(f"{folder}: an earlier run was interrupted while writing: its unfinished files were removed")
    return manifest


def taken_over(path: Path, content: str) -> None:
    """Take a file of ours for ours again that a person changed since.

    For a table that is written to be corrected: who calls this has read it, and writes what it says.

    Args:
        path: The file; one that was never ours is left alone.
        content: SHA-256 of what was read; a file that has changed since is left alone, too.

    Raises:
        OutputError: the folder cannot be written.
    """
    folder = path.parent
    with _answering(path), locked(folder, patience_s=PATIENCE_S):
        manifest = recovered(folder)
        owner = manifest.owner(path.name)
        if owner is None or manifest.results[owner].files[path.name] == content or not is_still(path, content):
            return
        files = {**manifest.results[owner].files, path.name: content}
        results = {**manifest.results, owner: dataclasses.replace(manifest.results[owner], files=files)}
        write_manifest(folder, dataclasses.replace(manifest, results=results))


@contextlib.contextmanager
def _stage(folder: Path) -> Iterator[Path]:
    """An empty hidden folder, locked while it is in use; gone afterwards, unless the result counts already."""
    stage = Path(tempfile.mkdtemp(prefix=PARTIAL, dir=folder))
    try:
        with locked(stage):
            yield stage
    finally:
        pending = None
        with contextlib.suppress(OutputError, OSError):
            pending = read_manifest(folder).pending
        if pending is None or pending.stage != stage.name:
            shutil.rmtree(stage, ignore_errors=True)


def _abandoned(stage: Path) -> bool:
    """Whether the process that made a hidden folder has ended."""
    if not stage.is_dir():
        return True
    try:
        with locked(stage):
            return True
    except (OutputError, OSError):
        return False


def _commit(
    folder: Path, stage: Path, name: str, *, inputs: Iterable[Path | None], take_over: bool, may_replace: bool = True
) -> None:
    """Make the files in a stage the result of that name; the caller holds the folder's lock."""
    new = {}
    for path in sorted(stage.rglob("*")):
        if path.is_file() and path.name != LOCK:
            with path.open("r+b") as stream:
                os.fsync(stream.fileno())
            new[path.relative_to(stage).as_posix()] = digest(path)
    manifest = read_manifest(folder)
    read = [path.resolve() for path in inputs if path is not None]
    replaces, folders = {}, []
    for file in new:
        target = folder / file
        if not is_below(file):
            raise OutputError(f"{target}: no file of this name can be found again on every system: choose another name")
        if target.resolve() in read:
            raise OutputError(f"{target} is read from: choose another place")
        folders += _missing_folders(folder, target.parent)
        if os.path.lexists(target):
            if not may_replace:
                raise OutputError(
                    f"{target} was created by another program in the meantime: give `overwrite` to replace it, or "
                    "another name"
                )
            replaces[file] = _refuse_foreign(folder, file, manifest, owner=None if take_over else name)
    old = manifest.results.get(name, Listing())
    replaces |= {
        file: content
        for file, content in old.files.items()
        if file not in new and is_inside(folder, file) and is_still(folder / file, content)
    }
    kept_folders = [f for f in old.folders if any(file.startswith(f"{f}/") for file in new)]
    listing = Listing(files=new, folders=tuple(dict.fromkeys([*kept_folders, *folders])))
    pending = Pending(name=name, stage=stage.name, new=listing, replaces=replaces)
    with _undisturbed(folder):
        sync_folder(stage)
        write_manifest(folder, dataclasses.replace(manifest, pending=pending))
        _finish(folder, dataclasses.replace(manifest, pending=pending))


def _finish(folder: Path, manifest: Manifest) -> Manifest:
    """Rename what a pending result has in its hidden folder, remove what it replaces, and list it."""
    pending = manifest.pending
    if pending is None:
        return manifest
    stage = folder / pending.stage
    try:
        staged = [file for file, content in pending.new.files.items() if _is_staged(stage, file, content)]
        for file in staged:
            with place_of(stage, file) as (source, name), place_of(folder, file, make=True) as (target, new):
                there = _is_there(target, new)
                if there and not is_still(new, pending.replaces.get(file, ""), within=target):
                    raise OutputError(
                        f"{folder / file} was changed while mocap wrote: move it away, then run any command that "
                        "writes there"
                    )
                os.replace(name, new, src_dir_fd=source, dst_dir_fd=target)
        for file in pending.replaces.keys() - pending.new.files.keys():
            with contextlib.suppress(FileNotFoundError), place_of(folder, file) as (target, name):
                if is_still(name, pending.replaces[file], within=target):
                    os.unlink(name, dir_fd=target)
        old = manifest.results.get(pending.name, Listing())
        for empty in sorted(set(old.folders) - set(pending.new.folders), reverse=True):
            with contextlib.suppress(OSError), place_of(folder, empty) as (target, name):
                os.rmdir(name, dir_fd=target)
        sync_folder(folder)
        gone = {*pending.new.files, *pending.replaces}
        others = {
            name: dataclasses.replace(listing, files={f: c for f, c in listing.files.items() if f not in gone})
            for name, listing in manifest.results.items()
            if name != pending.name
        }
        results = {name: listing for name, listing in others.items() if listing.files} | {pending.name: pending.new}
        done = Manifest(results=results)
        write_manifest(folder, done)
    except OSError as error:
        place = folder / (error.filename2 or error.filename or "")  # names are told relative to their folder
        advice = shown_elsewhere(OSError(error.errno, error.strerror, str(place)))
        raise OutputError(
            f"{folder}: the new result is complete, but {error.filename or 'a file'} could not be moved to its place "
            f"({error.strerror or error}): {advice}mocap view reads it; the next command that writes "
            "there finishes it",
            kept="the new result is complete",
        ) from None
    shutil.rmtree(stage, ignore_errors=True)
    return done


def _is_staged(stage: Path, file: str, content: str) -> bool:
    if not os.path.lexists(stage):
        return False
    if stage.is_symlink() or not stage.is_dir():
        raise OutputError(
            f"{stage} is no folder, but {MANIFEST} lists it as one with new files: move {MANIFEST} away, or choose "
            "another place"
        )
    try:
        with place_of(stage, file) as (source, name):
            if _is_there(source, name) and not is_still(name, content, within=source):
                raise OutputError(
                    f"{stage / file} is not the file that {MANIFEST} lists: move that away, or choose another place"
                )
            return _is_there(source, name)
    except FileNotFoundError:
        return False  # its folder went to its place


def _is_there(within: int | None, name: str) -> bool:
    try:
        os.stat(name, dir_fd=within, follow_symlinks=False)
    except FileNotFoundError:
        return False
    return True


def _refuse_inputs(target: Path, inputs: Iterable[Path | None], *, folder: bool) -> None:
    resolved = target.resolve()
    for read in [*(p.resolve() for p in inputs if p is not None), *([Path.cwd()] if folder else [])]:
        if resolved == read or (folder and resolved in read.parents):
            raise OutputError(f"{target} is, or contains, {read}, which is read from: choose another place")


def _refuse_unasked(folder: Path, name: str, manifest: Manifest, *, replace: bool, beside: bool) -> None:
    if replace:
        return
    if name in manifest.results:
        raise OutputError(f"{folder} exists: give `overwrite` to replace the earlier result, or another place")
    if not beside and any(path.name != MANIFEST and not path.name.startswith(PARTIAL) for path in folder.iterdir()):
        raise OutputError(
            f"{folder} exists and contains other files: give `overwrite` to write beside them (they stay as they "
            "are), or choose another place"
        )


def _refuse_foreign(folder: Path, file: str, manifest: Manifest, *, owner: str | None = None) -> str:
    """The content of a file of ours that may be replaced; it must belong to the result ``owner``, if one is named."""
    path, found = folder / file, manifest.owner(file)
    if found is None:
        raise OutputError(
            f"{path} was not written by mocap (no {MANIFEST} lists it): it is never replaced; move it away, or "
            "choose another place"
        )
    if owner is not None and found != owner:
        raise OutputError(f"{path} belongs to the result of another command ({found}): choose another place")
    content = manifest.results[found].files[file]
    if not is_still(path, content):
        raise OutputError(
            f"{path} was changed after mocap wrote it: it is never replaced; move it away, or choose another place"
        )
    return content


def _missing_folders(folder: Path, parent: Path) -> list[str]:
    """Folders below ``folder`` that have to be made for a file; all others are on its file system."""
    missing = []
    while parent != folder:
        if parent.is_symlink():
            raise OutputError(
                f"{parent} is a link, but files of the result are to be written there: put a folder in its place, or "
                "choose another place"
            )
        if parent.is_dir():
            if parent.stat().st_dev != folder.stat().st_dev:
                raise OutputError(f"{parent} is on another file system than {folder}: choose another place")
        elif os.path.lexists(parent):
            raise OutputError(
                f"{parent} is not a folder, but files of the result are to be written there: choose another place"
            )
        else:
            missing.append(parent.relative_to(folder).as_posix())
        parent = parent.parent
    return missing


def _make_folder(folder: Path) -> list[Path]:
    """Make a folder and those above it; those that were made, the innermost first."""
    made = [folder, *folder.parents]
    made = made[: next(i for i, path in enumerate(made) if path.exists() or path == path.parent)]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except FileExistsError:
        raise OutputError(f"{folder} is a file: choose another place") from None
    except OSError as error:
        _remove_empty(made)
        raise OutputError(f"{folder}: cannot be written: {error.strerror}; choose another place") from None
    return made


def _remove_empty(folders: Iterable[Path]) -> None:
    for path in folders:
        with contextlib.suppress(OSError):
            path.rmdir()


@contextlib.contextmanager
def _answering(place: Path) -> Iterator[None]:
    """Turn errors of the system into one line, and tell an interrupted command what was kept."""
    try:
        yield
    except KeyboardInterrupt as stop:
        if not hasattr(stop, "kept"):
            stop.kept = f"{place} is as it was before"  # type: ignore[attr-defined]
        raise
    except OSError as error:
        named = None if error.filename is None else Path(os.fsdecode(error.filename)).resolve()
        if named is not None and place.resolve().parent not in named.parents:
            raise  # it is not the result that could not be written
        reason = error.strerror or str(error)
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        raise OutputError(
            f"{place}: cannot be written: {reason}; nothing there was changed: "
            + ("free some space, or choose another place" if full else f"{shown_elsewhere(error)}choose another place"),
            kept=getattr(error, "kept", ""),
        ) from error


@contextlib.contextmanager
def _undisturbed(folder: Path) -> Iterator[None]:
    """Let Ctrl-C, and SIGTERM where it does not kill, wait until the files are there; that takes milliseconds."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    heard = [n for n in (signal.SIGINT, signal.SIGTERM) if callable(signal.getsignal(n))]
    before: dict[int, Any] = {n: signal.signal(n, lambda number, _: received.append(number)) for n in heard}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if received:
        try:
            before[received[0]](received[0], None)
        except KeyboardInterrupt as stop:
            stop.kept = f"the new result in {folder} is complete"  # type: ignore[attr-defined]
            raise
