"""Libraries that damaged files send into endless loops or forbidden memory read in a process of their own."""

import subprocess
import sys
import tempfile
from pathlib import Path

from mocap.errors import FormatError

REFUSED = 3
"""Exit code of a script whose library refuses the file; the reason is on stdout."""


def read_apart(path: Path, script: str, *, kind: str, seconds: float) -> bytes:
    """What ``python SCRIPT FILE OUT``, a script of this folder, writes to OUT.

    Args:
        path: The file.
        script: Name of the script.
        kind: What the file should be, for messages.
        seconds: After so long (and a second for each megabyte) the file is given up.

    Raises:
        FormatError: the library refuses the file, crashes on it, or does not come to an end.
    """
    broken = FormatError(f"{path.name}: the head of this {kind} file is damaged: copy or export it again")
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "out"
        command = [sys.executable, "-P", str(Path(__file__).with_name(script)), str(path.absolute()), str(out)]
        try:
            limit = seconds + path.stat().st_size / 1e6
            done = subprocess.run(command, capture_output=True, text=True, timeout=limit, check=False)
        except subprocess.TimeoutExpired:
            raise broken from None
        if done.returncode == REFUSED:
            reason, _, _ = done.stdout.partition(", please")
            raise FormatError(f"{path.name}: cannot be read as {kind} ({reason}): it is damaged, or export it again")
        if done.returncode != 0 or not out.exists():
            raise broken
        return out.read_bytes()
