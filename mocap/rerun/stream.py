"""A rerun recording into a file: made in memory, then written by us, so that a full disk is an error like any other."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from mocap.errors import MocapError


class RecordingError(MocapError):
    """A recording could not be made."""


@contextmanager
def recording_into(
    path: Path, *, application: str, recording_id: str, blueprint: rrb.Blueprint
) -> Iterator[rr.RecordingStream]:
    """A stream whose content is in the file afterwards; data that the viewer cannot take are an error meanwhile.

    rerun's own file sink says nothing of a write that fails, and may wait for ever.

    Args:
        path: The ``.rrd`` to write; its folder exists.
        application: What the viewer remembers layouts by.
        recording_id: Of the recording.
        blueprint: What is where on the screen.

    Yields:
        The stream.

    Raises:
        RecordingError: rerun is switched off, or does not take the data.
        OSError: the file cannot be written.
    """
    strict = rr.strict_mode()
    rr.set_strict_mode(True)
    try:
        rec = rr.RecordingStream(application, recording_id=recording_id, send_properties=False)
        rec.set_log_time_enabled(False)
        try:
            buffer = rec.binary_stream()
            rec.send_blueprint(blueprint, make_active=True, make_default=True)  # else a browser makes up views
            yield rec
            content = buffer.read(flush=True, flush_timeout_sec=600)
        except RuntimeError as error:
            raise RecordingError(
                f"{path.name}: the recording was not made ({error}): is the environment variable RERUN set to off?"
            ) from error
        finally:
            rec.disconnect()
    finally:
        rr.set_strict_mode(strict)
    if not content:
        raise RecordingError(f"{path.name}: rerun recorded nothing: is the environment variable RERUN set to off?")
    path.write_bytes(content)
