"""The report of a run, to read beside the pictures."""

import rerun as rr

from mocap.rerun import paths


def log_report(rec: rr.RecordingStream, markdown: str) -> None:
    """The text as a document."""
    rec.log(paths.REPORT, rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN), static=True)
