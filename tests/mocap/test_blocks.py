"""Long recordings in blocks: the same track as the whole at once, tables of every frame, any range of them."""

from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from mocap.datasets import make_bat
from mocap.filters.hidden_gaps import EACH_MARKER, Effort
from mocap.filters.models.base import FittedMotion
from mocap.filters.models.constant_velocity import MarkerSettings

import mocap
from docs.tools import columns
from mocap.cleaning.cleaning import clean
from mocap.cli.main import main
from mocap.cli.view import detail
from mocap.errors import MocapError
from mocap.findings import Finding, Kind, over_blocks
from mocap.io.output import result_folder
from mocap.progress import Stages
from mocap.reading.ideal_pixels import of_pixels
from mocap.recording import Recording, of_points
from mocap.records import MarkerTracks, Status, marker_tracks
from mocap.rerun.record import write_recording
from mocap.results.blocks import load_range
from mocap.results.long_result import write_in_blocks
from mocap.skeleton import Joint, Skeleton
from mocap.tracking.blocks import LEAST, MOST, blocks_of, learn_excerpts, margin, track_block
from mocap.tracking.learning import learn_from
from mocap.tracking.track_part import track_part
from mocap.tracking.tracking import learn_motion, seen_part

T = 350
SHOWN = [*range(9), 13, 14, 17]  # trunk and an arm of the bat


def in_blocks(recording, folder, *, size):
    """The report of a result that is written with constant velocity."""
    with result_folder(folder, "track", replace=False) as stage:
        return write_in_blocks(recording, stage, model="constant_velocity", size=size).report


@pytest.fixture(scope="module")
def bat() -> Recording:
    """Positions of a bat with gaps; a stretch in which nothing is seen."""
    film = make_bat(n_frames=T, n_cameras=2)
    names = tuple(film.truth.names[m] for m in SHOWN)
    rng = np.random.default_rng(0)
    xyz = film.truth.xyz_m[:, SHOWN]
    xyz = xyz + 3e-4 * rng.standard_normal(xyz.shape)
    xyz[rng.random(xyz.shape[:2]) < 0.1] = np.nan
    xyz[90:120, 5] = np.nan
    xyz[250:270] = np.nan
    seen = np.isfinite(xyz[..., 0])
    cov = np.where(seen, 9e-8, np.nan)[..., None, None] * np.eye(3)
    status = np.where(seen, Status.MEASURED, Status.MISSING).astype(np.int8)
    tracks = MarkerTracks(names=names, t_s=film.truth.t_s, xyz_m=xyz, cov_m2=cov, status=status)
    joint = Joint(name="neck", parent=names[0], centre=names[4], child=names[8])
    skeleton = Skeleton(name="part of a bat", markers=names, trunk=names[4:8], joints=(joint,))
    return of_points(tracks, skeleton, name="bat")


@pytest.fixture(scope="module", autouse=True)
def one_motion(bat):
    """Constant velocity with the accelerations of the whole, which each block would learn of its own frames.

    Margins last half as long as in use: what they are for is over after a tenth of that.
    """
    cleaned = clean(bat)
    once = learn_motion(seen_part(cleaned), MarkerSettings()).motion

    def known(part, settings):
        xyz = part.xyz_m
        first = xyz[np.isfinite(xyz[..., 0]).argmax(axis=0), np.arange(xyz.shape[1])]
        if xyz.shape[1] != len(SHOWN):  # another recording
            return learn_motion(part, settings)
        return FittedMotion(replace(once, start_m=first), part.t_s)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mocap.tracking.track_part.learn_motion", known)
        patch.setattr("mocap.tracking.blocks.LEAST_S", 0.25)
        yield


@pytest.fixture(scope="module")
def whole(bat):
    """The track of all frames at once."""
    return track_block(bat, range(T))[0]


def test_blocks_give_the_track_of_the_whole(bat, whole):
    """A filter that has seen each marker in 30 frames has forgotten where it began.

    The slowest mode of constant velocity with these noises falls by e in 3 frames; margins of 60 frames leave e^-20.
    """
    parts = []
    for core in blocks_of(T, 100):
        run, _, own, _ = track_block(bat, core)
        assert own.stop - own.start == len(core)
        names = ["position", "covariance", "status", "velocity"]
        parts.append(run.at(own).data[names])
    ours, theirs = xr.concat(parts, dim="time"), whole.data
    np.testing.assert_array_equal(ours["time"], theirs["time"])
    np.testing.assert_array_equal(ours["status"], theirs["status"])
    np.testing.assert_allclose(ours["position"], theirs["position"], atol=1e-9)
    np.testing.assert_allclose(ours["covariance"], theirs["covariance"], rtol=1e-7, atol=1e-15)
    np.testing.assert_allclose(ours["velocity"], theirs["velocity"], atol=1e-7)


def test_blocks_are_all_frames_once():
    """No frame is left out, none is twice, and no block is longer than asked."""
    for n, size in ((1, 5), (10, 5), (11, 5), (1000, 333)):
        blocks = blocks_of(n, size)
        assert [frame for block in blocks for frame in block] == list(range(n))
        assert max(map(len, blocks)) <= size


def test_margins_reach_to_where_each_marker_is_seen():
    """Past a gap by 30 frames; no further than there is to look at, or than is of use."""
    seen = np.ones((3000, 3), dtype=bool)
    assert margin(seen, 0.01) == LEAST
    seen[:200, 1] = False
    assert margin(seen, 0.01) == 230
    seen[:, 2] = False  # never seen: nothing to wait for
    assert margin(seen, 0.01) == 230
    seen[:2900, 1] = False
    assert margin(seen, 0.01) == LEAST
    seen[990, 1] = True
    assert margin(seen, 0.01) == 991 <= MOST
    assert margin(seen[:40], 0.01) == 40
    assert margin(seen[:0], 0.01) == 0


@pytest.fixture(scope="module")
def folder(bat, tmp_path_factory):
    """A result in blocks."""
    out = tmp_path_factory.mktemp("long") / "out"
    in_blocks(bat, out, size=125)
    return out


def test_tables_hold_every_frame(whole, folder):
    """The long table is one that mocap reads, the kinematics have a row a frame, and both are the track."""
    points = mocap.read(folder / "markers.parquet").points
    np.testing.assert_allclose(points.xyz_m, whole.tracks.xyz_m, atol=1e-9)
    np.testing.assert_array_equal(points.status, whole.tracks.status)
    table = pd.read_parquet(folder / "kinematics.parquet")
    assert table["frame"].tolist() == list(range(1, T + 1))
    flexion = mocap.load(folder).kinematics  # the overview, of the same frames where there are few
    assert len(flexion.t_s) == T
    name = next(name for name in table if name.endswith("_flexion_deg"))
    np.testing.assert_allclose(table[name], flexion[name].value, atol=0.05)
    blocks = pd.read_csv(folder / "blocks.csv")
    assert blocks["last_frame"].tolist() == [116, 233, 350]
    assert blocks["measured"].mean() == pytest.approx((whole.tracks.status == Status.MEASURED).mean(), abs=1e-3)


def test_every_column_is_documented(folder):
    """Of the files that only recordings in blocks have."""
    assert not columns.undocumented(pd.read_parquet(folder / "markers.parquet").columns, "markers.parquet", {})
    assert not columns.undocumented(pd.read_csv(folder / "blocks.csv", nrows=0).columns, "blocks.csv", {})


def test_any_range_of_frames(folder):
    """A range over the border of two blocks is read with its covariances, as single precision holds them."""
    whole = mocap.load(folder).tracks
    run = load_range(folder, range(220, 260))
    np.testing.assert_array_equal(run.xyz_m, whole.xyz_m[220:260])
    np.testing.assert_allclose(run.cov_m2, whole.cov_m2[220:260], rtol=1e-5, atol=1e-12)
    np.testing.assert_array_equal(run.tracks.status, whole.status[220:260])
    world = mocap.load(folder).data["joint_world"].values[220:260]
    np.testing.assert_allclose(run.data["joint_world"].values, world, atol=1e-12)
    with pytest.raises(MocapError, match="has the frames 1 to 350"):
        load_range(folder, range(340, 360))


def test_the_overview_keeps_numbers_of_frames(bat, tmp_path, monkeypatch):
    """Every third frame, numbered and timed as in the recording."""
    import pyarrow as pa
    from rerun.chunk import RrdReader

    from mocap.rerun import paths
    from mocap.rerun.columns import TIME

    monkeypatch.setattr("mocap.rerun.record.write_recording", write_recording)
    monkeypatch.setattr("mocap.results.long_result.OVERVIEW", 120)
    report = in_blocks(bat, tmp_path / "out", size=200)
    assert report["blocks"] == {"frames": 200, "every": 3, "shown": 117}
    assert report["validation"]["hidden_samples"] > 0  # of one block
    frames, times = set(), {}
    for chunk in RrdReader(str(tmp_path / "out" / "recording.rrd")).stream():
        batch = chunk.to_record_batch()
        if "frame" in batch.schema.names:
            frames |= set(batch.column("frame").to_pylist())
            if chunk.entity_path == paths.SKELETON:
                nanoseconds = batch.column(TIME).cast(pa.int64()).to_pylist()
                times |= dict(zip(batch.column("frame").to_pylist(), nanoseconds, strict=True))
    np.testing.assert_allclose(np.diff([times[f] for f in sorted(times)]), 3e9 * bat.dt_s, atol=10)
    assert len(times) == 117
    assert frames <= set(range(1, T + 1, 3))
    assert {1, 349} <= frames


def test_the_command_line(folder, tmp_path, monkeypatch, capsys):
    """``mocap track --blocks`` gives the tables, ``mocap.load`` any of their frames; what cannot be is refused."""
    source = folder / "markers.parquet"
    monkeypatch.setattr("mocap.rerun.record.write_recording", write_recording)

    def run(*words: object) -> int:
        monkeypatch.setattr("sys.argv", ["mocap", *map(str, words)])
        with pytest.raises(SystemExit) as stopped:
            main()
        return stopped.value.code

    out = tmp_path / "out"
    assert run("track", source, "--blocks", 150, "--model", "constant_velocity", "--out", out) == 0
    assert "in blocks of at most 150 frames" in (out / "report.md").read_text()
    part = mocap.load(out, frames=range(230, 236))
    assert part.markers.sizes["time"] == 6
    assert detail(out, "231:236", tmp_path / "part.rrd").stat().st_size > 1000
    capsys.readouterr()
    assert run("view", out, "--frames", "7") == 1
    assert "FIRST:LAST" in capsys.readouterr().err


def test_findings_of_stretches_tell_the_frames_of_the_recording():
    """An exchange of names and a marker that is set elsewhere, in a stretch that begins at frame 201."""
    film = make_bat(n_frames=500, n_cameras=2)
    xyz, names = film.truth.xyz_m[:, SHOWN].copy(), tuple(film.truth.names[m] for m in SHOWN)
    xyz[260:280, [0, 5]] = xyz[260:280, [5, 0]]
    xyz[350:, 8] += 0.5
    tracks = marker_tracks(names, film.truth.t_s, xyz)
    skeleton = Skeleton(name="part of a bat", markers=names, trunk=names[4:8])
    found = clean(of_points(tracks, skeleton, name="bat").at(slice(200, 450)), first=200).findings
    said = " ".join(map(str, found))
    assert "from frame 261 to 280" in said
    assert "between frames 350 and 351" in said


def test_findings_of_blocks():
    """What many blocks find is one finding, whatever its numbers; of other markers or cameras it is another one."""
    blocks = [
        [
            Finding(kind=Kind.POSITION_NOISE, text=f"noise of 0.{number} mm", numbers={"mm": number / 10}),
            Finding(kind=Kind.IDENTITY_SWITCH, text=f"{marker} from frame {number}", markers=(marker,)),
        ]
        for number, marker in ((1, "a"), (2, "b"), (3, "a"))
    ]
    assert [str(one) for one in over_blocks(blocks)] == [
        "noise of 0.1 mm (and in 2 other blocks, with their own numbers)",
        "a from frame 1 (and in 1 other block, with their own numbers)",
        "b from frame 2",
    ]
    late = [
        Finding(kind=Kind.CAMERA_OFFSET, text=" ".join(names), cameras=names)
        for names in (("1", "2"), ("2", "3"), ("2",))
    ]
    assert [str(one) for one in over_blocks([[one] for one in late])] == [
        "1 2 (and in 1 other block, with their own numbers)",
        "2 3",
    ]


def test_what_one_block_never_sees_is_not_said_of_the_recording():
    """Of two blocks that lack a and b, and b, only b is never seen; a block that sees all: none is."""

    def unseen(*markers):
        return Finding(kind=Kind.NEVER_SEEN, alarm=True, text=f"never seen: {', '.join(markers)}", markers=markers)

    (one,) = over_blocks([[unseen("a", "b")], [unseen("b")]])
    assert str(one).startswith("never seen: b")
    assert one.markers == ("b",)
    assert over_blocks([[unseen("a", "b")], []]) == []


def test_what_one_block_never_shows_together_is_not_said_of_the_recording():
    """A block of a few samples shows no pose; where most blocks show none, markers may be of several animals."""
    apart = Finding(kind=Kind.NEVER_TOGETHER, alarm=True, text="no frame shows more than 3 of the 9 points")
    assert over_blocks([[apart], [], []]) == []
    (one,) = over_blocks([[apart], [apart], []])
    assert one.alarm
    assert one.kind is Kind.NEVER_TOGETHER


def test_an_alarm_of_several_blocks_keeps_what_mends_it():
    """Also where its kind does not tell that, as of the other trials."""
    said = {"kind": Kind.UNLIKE_SIBLINGS, "alarm": True, "mends": ("fps",)}
    (one,) = over_blocks([[Finding(text=f"frame rate: {k}", **said)] for k in range(3)])
    assert one.mends == ("fps",)


def test_cycles_of_all_blocks_are_those_of_the_whole(tmp_path):
    """Angles of every cycle have their means, in the columns of all blocks; the first block has no cycle at all."""
    t_s = np.arange(420) / 100
    beat = 0.8 * np.sin(2 * np.pi * 4 * t_s)
    zero = np.zeros_like(t_s)
    points = {
        "keel": np.stack([zero, zero, zero - 0.02], 1),
        "neck": np.stack([zero + 0.05, zero, zero], 1),
        "rump": np.stack([zero - 0.05, zero, zero], 1),
        "root": np.stack([zero, zero + 0.01, zero], 1),
        "tip": np.stack([zero, 0.01 + 0.1 * np.cos(beat), 0.1 * np.sin(beat)], 1),
    }
    xyz = np.stack(list(points.values()), 1) + np.random.default_rng(0).normal(0, 1e-4, (420, 5, 3))
    xyz[:190, 4] = np.nan
    skeleton = Skeleton(
        markers=list(points),
        trunk=("keel", "neck", "rump"),
        joints={"wing": ("rump", "root", "tip")},
        measures={"forward": ["rump", "neck"], "left": ["keel", "root"], "strokes": {"wing": ["root", "tip"]}},
    )
    recording = of_points(marker_tracks(list(points), t_s, xyz), skeleton, name="flight")
    in_blocks(recording, tmp_path / "blocks", size=140)
    in_blocks(recording, tmp_path / "whole", size=420)
    for name in ("cycles.csv", "angles.csv"):
        found, whole = pd.read_csv(tmp_path / "blocks" / name), pd.read_csv(tmp_path / "whole" / name)
        assert list(found.columns) == list(whole.columns)
        assert len(found) == len(whole) > 6
        assert found["number"].tolist() == whole["number"].tolist()
        for title in ("start_s", "end_s", "frequency_hz", "wing_flexion_deg"):  # others are in axes of a block's own
            if title in found:  # its noise of 0.1 mm is 0.1 degrees of the limb
                np.testing.assert_allclose(found[title], whole[title], atol=0.2)
    assert "wing_flexion_deg" in found


def test_rays_in_blocks_of_which_some_show_nothing(tmp_path, monkeypatch):
    """The report has residuals and counts of all frames; where nothing is seen all is missing, and is written."""
    monkeypatch.setattr("mocap.tracking.blocks.MOST", 20)
    monkeypatch.setattr("mocap.tracking.blocks.LEAST", 10)
    monkeypatch.setattr("mocap.tracking.blocks.LEAST_S", 0.0)
    film = make_bat(n_frames=200, n_cameras=3)
    names, uv = film.truth.names[:9], np.array(film.pixels.uv_px[:, :, :9])
    uv[:, 60:140] = np.nan
    pixels = replace(film.pixels, names=names, uv_px=uv)
    joint = Joint(name="neck", parent=names[0], centre=names[4], child=names[8])
    skeleton = Skeleton(name="trunk", markers=names, trunk=names[4:8], joints=(joint,))
    report = in_blocks(of_pixels(pixels, film.cameras, skeleton, name="bat"), tmp_path / "out", size=25)
    assert report["tracked_frames"] == [1, 200]
    assert report["samples"]["total"] == 200 * 9
    assert report["samples"]["missing"] == pytest.approx(0.4, abs=0.15)  # less what is extrapolated
    assert 0 < report["residual_px"]["50%"] < 2
    assert report["joints"]["neck"]["samples"] > 15
    assert not any("in 7 other blocks" in text and "corner" in text for text in report["findings"])
    table = pd.read_parquet(tmp_path / "out" / "kinematics.parquet")
    assert table["frame"].tolist() == list(range(1, 201))
    assert table["neck_flexion_deg"][75:125].isna().all()
    assert table["neck_flexion_deg"][:50].notna().all()
    assert mocap.load(tmp_path / "out").report["cameras"] == [camera.name for camera in film.cameras]


def test_a_mixture_is_learned_once(bat, monkeypatch):
    """Of stretches of the recording; those inside a block are no part of what it is tracked with."""
    monkeypatch.setattr("mocap.tracking.blocks.EXCERPTS", 2)
    monkeypatch.setattr("mocap.tracking.blocks.EXCERPT", 120)
    each = partial(learn_from, models=(EACH_MARKER, MarkerSettings()), effort=Effort(validated=1, times=1))
    monkeypatch.setattr("mocap.tracking.blocks.learn_from", each)
    given = []
    monkeypatch.setattr(
        "mocap.tracking.blocks.track_part",
        lambda *one, **options: given.append(options["learned"]) or track_part(*one, **options),
    )
    told = []
    learned, why = learn_excerpts(bat, stages=Stages(tell=lambda *said: told.append(said)))
    stages = [stage for stage, share in told if 0.0 < share < 1.0]
    assert stages[0] == "read, triangulate, clean"
    assert stages[-1] == "learn, fill hidden gaps"
    assert why == "learned from 2 x 120 frames of it"
    assert [trial.name for trial in learned.trials] == ["frames 1 to 120", "frames 231 to 350"]
    run, cleaned, own, _ = track_block(bat, range(100), learned=learned, excerpts=True)
    assert [trial.name for trial in given[0].trials] == ["frames 231 to 350"]
    assert run.model == "learned"
    assert own.stop - own.start == 100
    hidden = np.isnan(cleaned.xyz_m[own][..., 0])
    assert np.isfinite(run.xyz_m[own][hidden]).all()
