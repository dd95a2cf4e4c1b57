"""A new tab of the viewer is one file with ``log`` and ``tab``, and one line in the registry."""

from types import SimpleNamespace

import rerun as rr
import rerun.blueprint as rrb
from flapping import make_run
from readback import entities

from mocap.rerun import record
from mocap.rerun.record import write_recording
from mocap.rerun.tabs.registry import TABS


def test_a_registered_tab_is_logged_and_laid_out(monkeypatch, tmp_path):
    """Its entity is in the recording beside the others', its view the last tab; nothing else has to know it."""
    seen = {}

    def log(rec, run, layout):
        rec.log("/mine", rr.TextDocument(f"{run.name}, {layout.n_frames} frames"), static=True)

    def tab(layout):
        seen["asked"] = layout.name
        return rrb.TextDocumentView(origin="/mine", name="Mine")

    mine = (*TABS, SimpleNamespace(log=log, tab=tab))
    monkeypatch.setattr(record, "TABS", mine)
    run = make_run(n_frames=5, n_cameras=1, n_joints=0)
    write_recording(run, tmp_path / "a.rrd")
    assert "/mine" in entities(tmp_path / "a.rrd")
    assert seen["asked"] == run.name


def test_a_tab_without_content_is_left_out():
    """No cameras, no joints, no Lagrangian: overview, angles, health and report remain."""
    run = make_run(n_frames=5, n_cameras=0, n_joints=0)
    layout = record.make_layout(run)
    assert [tab.tab(layout) is not None for tab in TABS] == [True, True, False, False, False, True, True]
