"""Tab: the report, to read beside the images."""

import rerun as rr
import rerun.blueprint as rrb

from mocap.rerun import paths
from mocap.rerun.layout import Layout
from mocap.tracking.result import Result


def log(rec: rr.RecordingStream, run: Result, layout: Layout) -> None:  # noqa: ARG001 - as every tab
    """The text as a document."""
    rec.log(paths.REPORT, rr.TextDocument(run.report_text, media_type=rr.MediaType.MARKDOWN), static=True)


def tab(layout: Layout) -> rrb.View:  # noqa: ARG001 - as every tab
    """The report."""
    return rrb.TextDocumentView(origin=paths.REPORT, name="Report")
