"""A process that ends with its parent, however that ends.

``started`` runs this file as a small process of its own between the two. It holds the reading end of a pipe whose
writing end only the parent has. The system closes that end when the parent dies, by SIGKILL or a crash too; then, and
when the parent closes it, the guardian ends what it started. Pipes close so on every platform; a signal at the parent's
death (prctl) exists on Linux only and follows the thread that asked for it, a job object exists on Windows only.

The guardian has a session of its own, so that signals to the group of the parent (Ctrl-C, a terminal that closes) reach
the parent alone, whose end it then sees. Run as a program it imports the standard library only, and starts in 20 ms.
"""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from typing import IO


def started(
    command: Sequence[str], *, environment: Mapping[str, str], output: IO[bytes] | int
) -> subprocess.Popen[bytes]:
    """Start a command that ends with this process.

    Args:
        command: Program and arguments.
        environment: Its environment.
        output: Where its stdout and stderr go.

    Returns:
        The guardian: it ends when the command does, with its exit code (128 and the signal's number where a signal
        ended it). End both with ``end``.
    """
    own_group = subprocess.CREATE_NEW_PROCESS_GROUP if sys.platform == "win32" else 0
    return subprocess.Popen(
        [sys.executable, "-I", "-S", __file__, *command],
        env=dict(environment),
        stdin=subprocess.PIPE,
        stdout=output,
        stderr=output,
        start_new_session=True,  # where there are sessions; Windows has groups
        creationflags=own_group,
    )


def end(guardian: subprocess.Popen[bytes]) -> None:
    """End what was started, and wait until it is gone."""
    if guardian.stdin is not None:
        guardian.stdin.close()
    guardian.wait()  # it kills what does not listen, and would leave it behind if it were killed itself


def _guard(command: Sequence[str]) -> int:
    """Run a command until it ends or stdin closes; its exit code."""
    child = subprocess.Popen(command, stdin=subprocess.DEVNULL)

    def end_child(*_: object) -> None:
        child.terminate()
        try:
            child.wait(timeout=3.0)
        except subprocess.TimeoutExpired:
            child.kill()

    def watch() -> None:
        while os.read(0, 4096):
            pass
        end_child()

    signal.signal(signal.SIGTERM, lambda *_: threading.Thread(target=end_child).start())
    threading.Thread(target=watch, daemon=True).start()
    code = child.wait()
    return code if code >= 0 else 128 - code


if __name__ == "__main__":
    sys.exit(_guard(sys.argv[1:]))
