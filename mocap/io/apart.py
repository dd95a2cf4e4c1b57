"""Libraries that damaged files send into endless loops or forbidden memory read in a process of their own.

What they read comes back through a pipe: no folder for temporary files can be full.
"""

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from mocap.errors import FormatError
from mocap.io.bounds import most_bytes
from mocap.io.windows import limit_memory

REFUSED = 3
"""Exit code of a script that refuses the file; the reason is on stdout."""
SPARE_BYTES = 1 << 29
"""What libraries may need beside what they read."""
UNKNOWN_BYTES = 2 << 30
"""Address space of Python with its libraries where the system does not tell."""


def read_apart(path: Path, script: str, *, kind: str, seconds: float) -> bytes:
    """What ``python -m SCRIPT FILE MOST`` writes to stdout, with the packages that run here.

    Args:
        path: The file.
        script: Name of a module of this folder that calls ``answer``.
        kind: What the file should be, for messages.
        seconds: After so long (and a second for each megabyte) the file is given up.

    Raises:
        FormatError: the script refuses the file, crashes on it, or does not come to an end.
    """
    module = f"{__name__.rpartition('.')[0]}.{script}"
    command = [sys.executable, "-P", "-m", module, str(path.absolute()), str(most_bytes(path))]
    packages = [str(Path(__file__).resolve().parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(packages)}
    try:
        limit = seconds + path.stat().st_size / 1e6
        done = subprocess.run(command, capture_output=True, timeout=limit, check=False, env=environment)
    except subprocess.TimeoutExpired:
        raise FormatError(
            f"{path.name}: was not read as {kind} within {limit:.0f} s: try again when the computer is idle"
        ) from None
    except OSError as error:
        raise FormatError(
            f"{path.name}: the process that reads it could not be started ({error.strerror}): try again"
        ) from None
    if done.returncode == REFUSED:
        reason = done.stdout.decode("utf-8", "replace")
        raise FormatError(f"{path.name}: cannot be read as {kind} ({reason}): copy or export it again")
    if done.returncode != 0 or not done.stdout:
        raise FormatError(f"{path.name}: the library that reads {kind} crashed on it: copy or export it again")
    return done.stdout


def answer(read: Callable[[str, int], bytes]) -> int:
    """The part of a script: ``read(FILE, MOST)`` within limited memory, its result or its trouble to stdout.

    Whatever the libraries print goes to stderr.

    Returns:
        The exit code: 0, or REFUSED.
    """
    path, most = sys.argv[1], int(sys.argv[2])
    out, code = os.dup(1), 0
    os.dup2(2, 1)
    more = SPARE_BYTES + 2 * most  # as it is read, and as it is sent
    if sys.platform == "win32":
        limit_memory(UNKNOWN_BYTES + more)
    else:
        import resource

        with contextlib.suppress(ValueError, OSError):  # macOS takes no such limit: that of time is left
            allowed = _address_space(resource.getpagesize()) + more
            resource.setrlimit(resource.RLIMIT_AS, (allowed, allowed))
    try:
        result = read(path, most)
    except MemoryError:
        result, code = b"it asks for more memory than a file of its size can need", REFUSED
    except Exception as error:  # libraries raise whatever their parsers stumble over
        words = " ".join(str(error).split())
        result, code = f"{type(error).__name__}: {words}".encode("utf-8", "replace"), REFUSED
    with open(out, "wb") as stream:
        stream.write(result)
    return code


def _address_space(page: int) -> int:
    """Bytes of address space that this process has."""
    try:
        return page * int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except OSError:
        return UNKNOWN_BYTES
