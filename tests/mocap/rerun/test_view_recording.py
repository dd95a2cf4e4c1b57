"""What is in the file, read back exactly."""

from io import BytesIO

import numpy as np
import pytest
import rerun as rr
from flapping import make_run
from PIL import Image
from readback import column, digest, entities
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from mocap.cameras.camera import project, stacked
from mocap.records import Status
from mocap.rerun import palette, paths
from mocap.rerun.landscape import STIFFNESS
from mocap.rerun.log_markers import ELLIPSOID_SD
from mocap.rerun.record import make_blueprint, make_layout, recording_id, write_recording
from mocap.rerun.scene_views import WHISKER_SCALE
from mocap.rerun.tabs.joints import CHART_SIZE
from mocap.tracking.potentials import joint_potentials

FILLED = (Status.SMOOTHED, Status.PREDICTED, Status.INTERPOLATED)


@pytest.fixture(scope="module")
def run():
    return make_run(n_frames=60, n_cameras=3)


@pytest.fixture(scope="module")
def rrd(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "recording.rrd"
    write_recording(run, path)
    return path


def held(frames, values, *, n_frames=60):
    """What a viewer shows in every frame: the last entry so far."""
    return values[np.searchsorted(frames, np.arange(n_frames), side="right") - 1]


def test_body_and_time_axes_are_exact(run, rrd):
    """Every position as its nearest float32, at its frame and its nanosecond."""
    markers = run.tracks
    frames, lengths, positions = column(rrd, paths.SKELETON, "Points3D:positions")
    np.testing.assert_array_equal(frames, np.arange(60))
    assert (lengths == len(markers.names)).all()
    np.testing.assert_array_equal(positions.reshape(markers.xyz_m.shape), markers.xyz_m.astype(np.float32))
    times, _, _ = column(rrd, paths.SKELETON, "Points3D:positions", index="time")
    np.testing.assert_array_equal(times, np.round(markers.t_s * 1e9).astype(np.int64))


@pytest.mark.parametrize(
    ("name", "codes"), [("measured", (Status.MEASURED,)), ("filled", FILLED), ("rejected", (Status.REJECTED,))]
)
def test_each_sample_is_in_the_entity_of_its_origin(run, rrd, name, codes):
    """Positions and marker numbers of a class, frame by frame."""
    markers = run.tracks
    mask = np.isin(markers.status, codes)
    path = paths.child(paths.MARKERS, name)
    frames, lengths, positions = column(rrd, path, "Points3D:positions")
    np.testing.assert_array_equal(held(frames, lengths), mask.sum(axis=1))
    np.testing.assert_array_equal(positions, markers.xyz_m[mask].astype(np.float32))
    _, _, ids = column(rrd, path, "Points3D:keypoint_ids")
    np.testing.assert_array_equal(ids, np.nonzero(mask)[1])


def test_ellipsoids_are_the_covariance(run, rrd):
    """Rotating the squared half axes back, over the squared number of deviations, is the covariance."""
    markers = run.tracks
    mask = np.isin(markers.status, FILLED)
    path = paths.child(paths.UNCERTAINTY, "filled")
    half = column(rrd, path, "Ellipsoids3D:half_sizes")[2].astype(np.float64)
    turn = Rotation.from_quat(column(rrd, path, "Ellipsoids3D:quaternions")[2]).as_matrix()
    cov = turn @ (np.eye(3) * (half[:, None] / ELLIPSOID_SD) ** 2) @ turn.swapaxes(-1, -2)
    # float32 keeps 6e-8 of each of three factors, against the largest variance
    np.testing.assert_allclose(cov, markers.cov_m2[mask], atol=1e-6 * markers.cov_m2[mask].max())


@pytest.mark.rare
@pytest.mark.parametrize("y_up", [False, True])
def test_pixels_and_whiskers_are_exact(tmp_path, y_up):
    """Measured, rejected and reprojected pixels run down in the view; whiskers go from measured towards reprojected."""
    run = make_run(n_frames=40, n_cameras=2, y_up=y_up)
    write_recording(run, tmp_path / "r.rrd")
    sign, offset = ((1, -1), (0, 800)) if y_up else ((1, 1), (0, 0))
    for c, name in enumerate(run.camera_names):
        image = paths.image(name)
        uv, used = run.ideal_px[c] * sign + offset, run.used[c]
        target = run.reprojected_px[c] * sign + offset
        measured = column(tmp_path / "r.rrd", f"{image}/measured", "Points2D:positions")[2].reshape(uv.shape)
        np.testing.assert_array_equal(measured, np.where(used[..., None], uv, np.nan).astype(np.float32))
        reprojected = column(tmp_path / "r.rrd", f"{image}/reprojected", "Points2D:positions")[2].reshape(uv.shape)
        np.testing.assert_array_equal(reprojected, target.astype(np.float32))
        left_out = np.isfinite(run.ideal_px[c, ..., 0]) & ~used
        frames, lengths, rejected = column(tmp_path / "r.rrd", f"{image}/rejected", "Points2D:positions")
        np.testing.assert_array_equal(held(frames, lengths, n_frames=40), left_out.sum(axis=1))
        np.testing.assert_array_equal(rejected, uv[left_out].astype(np.float32))
        strips = column(tmp_path / "r.rrd", f"{image}/residual", "LineStrips2D:strips")[2].reshape(-1, 2, 2)
        np.testing.assert_array_equal(strips[:, 0], uv[used].astype(np.float32))
        end = uv[used] + WHISKER_SCALE * (target[used] - uv[used])
        np.testing.assert_allclose(strips[:, 1], end, atol=2e-3)  # ten times float32's 6e-8 of 1280 px, twice


def test_logged_cameras_project_as_ours_do(run, rrd):
    """The pose and the pinhole in the file, multiplied out by SciPy, land on our pixels."""
    xyz = run.xyz_m[20]
    pixels = project(stacked(run.cameras), xyz)
    for camera, expected in zip(run.cameras, pixels, strict=True):
        path = paths.child(paths.CAMERAS, camera.name)
        position = column(rrd, path, "Transform3D:translation")[2][0]
        turn = Rotation.from_quat(column(rrd, path, "Transform3D:quaternion")[2][0])
        intrinsic = column(rrd, f"{path}/image", "Pinhole:image_from_camera")[2].reshape(3, 3).T
        inside = turn.inv().apply(xyz - position) @ intrinsic.T
        # float32 keeps 6e-8 of numbers near 1000 px, some factors long
        np.testing.assert_allclose(inside[:, :2] / inside[:, 2:], expected, atol=1e-3)


def test_gap_lanes_unfold_to_the_origins(run, rrd):
    """Holding each entry of a lane until the next gives the class of every frame."""
    markers = run.tracks
    label = {Status.MEASURED: "measured", Status.SMOOTHED: "filled", Status.REJECTED: "rejected", Status.MISSING: ""}
    for m, name in enumerate(markers.names):
        frames, _, states = column(rrd, paths.child(paths.GAPS, name), "StateChange:state")
        assert held(frames, states).tolist() == [label[Status(code)] for code in markers.status[:, m]]


def test_health_series(run, rrd):
    """Innovation squared a row, quantiles by SciPy, root mean squares by a loop, likelihood and rows as given."""
    np.testing.assert_array_equal(column(rrd, f"{paths.NIS}/value", "Scalars:scalars")[2], run.nis / run.n_rows)
    band = column(rrd, f"{paths.NIS}/band", "Scalars:scalars")[2].reshape(-1, 2)
    expected = [chi2(n).ppf((0.025, 0.975)) / n for n in run.n_rows]
    np.testing.assert_allclose(band, expected, rtol=1e-12)
    np.testing.assert_array_equal(column(rrd, paths.LOG_LIKELIHOOD, "Scalars:scalars")[2], run.log_likelihood)
    np.testing.assert_array_equal(column(rrd, paths.ROWS, "Scalars:scalars")[2], run.n_rows)
    for parent, difference in (
        (paths.INNOVATION, run.innovation_px),
        (paths.RESIDUAL, run.ideal_px - run.reprojected_px),
    ):
        assert tuple(column(rrd, parent, "SeriesLines:names")[2]) == run.camera_names
        lines = column(rrd, parent, "Scalars:scalars")[2].reshape(60, -1)
        for c in range(len(run.cameras)):
            for k in range(0, 60, 7):
                lengths = np.linalg.norm(difference[c, k][run.used[c, k]], axis=1)
                assert lines[k, c] == pytest.approx(np.sqrt(np.mean(lengths**2)), rel=1e-12)


def test_joint_moves_on_its_potential(run, rrd):
    """The value along the way is the potential's; the point on the surface is over the joint, at about that height."""
    for name, q_m in run.joints_m("plane").items():
        potential = run.potentials[name]
        value = column(rrd, f"{paths.joint(name, 'series')}/potential/value", "Scalars:scalars")[2]
        known = np.isfinite(q_m).all(axis=1)
        assert np.isnan(value[~known]).all()
        expected = potential.potential.value(q_m[known] / potential.scale_m)
        np.testing.assert_allclose(value[known], expected, rtol=1e-12)
        now = column(rrd, f"{paths.joint(name, 'surface')}/now", "Points3D:positions")[2]
        np.testing.assert_array_equal(now[:, :2], (q_m * 1000).astype(np.float32))
        land = make_layout(run).landscapes[name]
        # linear interpolation on the grid errs by cell^2 / 8 times the curvature, at most 4 beta in units of the scale
        error = (land.cell_mm / 1000 / potential.scale_m) ** 2 / 8 * 2 * 4 * 8.0
        np.testing.assert_allclose(now[known, 2] / land.height_mm - 0.015, expected, atol=error)
        flat = column(rrd, f"{paths.joint(name, 'map')}/now", "Points2D:positions")[2]
        np.testing.assert_array_equal(flat, (q_m * (1000, -1000)).astype(np.float32))


def test_potential_is_drawn_where_it_is(run, rrd):
    """Surface and map have the potential's height and colour at points that are worked out from the file alone."""
    name = "L_elbow"
    potential = run.potentials[name]

    def value(xy_mm):
        return potential.potential.value(np.asarray(xy_mm, dtype=np.float64) / 1000 / potential.scale_m)

    vertices = column(rrd, f"{paths.joint(name, 'surface')}/potential", "Mesh3D:vertex_positions")[2]
    height_mm = make_layout(run).landscapes[name].height_mm
    # float32 coordinates move V by 1e-5 mm times its slope, which is below 1 a millimetre
    np.testing.assert_allclose(vertices[:, 2] / height_mm, value(vertices[:, :2]), atol=1e-5)
    path = f"{paths.joint(name, 'map')}/potential"
    x0, y0, _ = column(rrd, path, "Transform3D:translation")[2][0]
    cell, _, _ = column(rrd, path, "Transform3D:scale")[2][0]
    blob = column(rrd, path, "EncodedImage:blob")[2]
    png = bytes(blob[0]) if blob.dtype == object else blob.tobytes()
    picture = np.asarray(Image.open(BytesIO(png)).convert("RGB")).astype(int)
    rows, columns = np.mgrid[: len(picture), : len(picture)] + 0.5
    at = value(np.stack([x0 + columns * cell, -(y0 + rows * cell)], axis=-1))
    sloped = (at > 0.05) & (at < 0.95)  # elsewhere the colour tells no place
    expected = palette.depth(at).astype(int)

    def off(other):
        return np.median(np.abs(other - expected).max(axis=-1)[sloped])

    # the median: dots, lines and words lie over less than half of it; interpolated colours err by some of 255
    assert off(picture) < 8
    assert min(off(picture[:, ::-1]), off(picture.transpose(1, 0, 2))) > 16
    assert off(picture) < off(picture[::-1])  # this joint bends nearly alike to both sides


def test_bound_is_the_energy_of_the_fastest_frame(run, rrd):
    """V(q0) + eps^2 |dq/dt|^2 / 2 where that is greatest, speed by differences; total = kinetic + potential."""
    t_s = run.t_s
    for name, q_m in run.joints_m("plane").items():
        series = paths.joint(name, "series")
        total, kinetic, held = column(rrd, f"{series}/energy", "Scalars:scalars")[2].reshape(-1, 3).T
        np.testing.assert_allclose(total, kinetic + held, rtol=1e-12)
        speed = (q_m[2:] - q_m[:-2]) / (t_s[2:] - t_s[:-2])[:, None]
        np.testing.assert_allclose(kinetic[1:-1], 0.5 * (speed**2).sum(axis=1), rtol=1e-9)
        value = column(rrd, f"{series}/potential/value", "Scalars:scalars")[2]
        strength = STIFFNESS * np.nanmax(kinetic)
        np.testing.assert_allclose(held, strength * value, rtol=1e-12)
        beside, bound = column(rrd, f"{series}/release", "Scalars:scalars")[2].reshape(-1, 2).T
        np.testing.assert_array_equal(beside, value)
        k = np.nanargmax(kinetic)
        np.testing.assert_allclose(bound, value[k] + kinetic[k] / strength, rtol=1e-12)


def test_range_and_preferred_configurations(run, rrd):
    """On the white line V is a half; red samples are the half of least V, as the potential itself says."""
    name = "L_elbow"
    potential = run.potentials[name]
    line = column(rrd, f"{paths.joint(name, 'surface')}/range", "LineStrips3D:strips")[2].reshape(-1, 3)[:, :2]
    at_line = potential.potential.value(line.astype(np.float64) / 1000 / potential.scale_m)
    land = make_layout(run).landscapes[name]
    # linear interpolation on the grid errs by cell^2 / 8 times the curvature, at most 4 beta in units of the scale
    error = (land.cell_mm / 1000 / potential.scale_m) ** 2 / 8 * 2 * 4 * 8.0
    np.testing.assert_allclose(at_line, 0.5, atol=error)
    drawn = np.concatenate(land.map.edge_mm)  # of the picture, whose grid is another
    cell_m = (land.map.x_mm[1] - land.map.x_mm[0]) / 1000
    at_edge = potential.potential.value(drawn / 1000 / potential.scale_m)
    np.testing.assert_allclose(at_edge, 0.5, atol=(cell_m / potential.scale_m) ** 2 / 8 * 2 * 4 * 8.0)
    at_samples = potential.potential.value(potential.samples_m / potential.scale_m)
    colors = column(rrd, f"{paths.joint(name, 'surface')}/samples", "Points3D:colors")[2]
    red = colors == int.from_bytes(bytes((*palette.PURPLE, 255)))
    np.testing.assert_array_equal(red, at_samples <= np.median(at_samples))


def test_spectrum_is_that_of_the_gram_matrix(run, rrd):
    """Dots are the eigenvalues of K / N by NumPy, a decade an eighth of the frame; the line is at lambda."""
    name = "L_elbow"
    joint = run.potentials[name]
    z = joint.samples_m / joint.scale_m
    gram = np.exp(-8.0 * ((z[:, None] - z) ** 2).sum(axis=-1)) / len(z)
    dots = column(rrd, f"{paths.joint(name, 'spectrum')}/dots", "Points2D:positions")[2]
    decades = 8 * dots[:, 1].astype(np.float64) / CHART_SIZE[1]
    expected = np.sort(np.linalg.eigvalsh(gram))[::-1][: len(decades)]
    large = expected > 1e-4  # a low-rank factor leaves out 1e-5
    np.testing.assert_allclose(10.0 ** -decades[large], expected[large], rtol=0.1)
    lines = column(rrd, f"{paths.joint(name, 'spectrum')}/lines", "LineStrips2D:strips")[2].reshape(-1, 2)
    np.testing.assert_allclose(8 * lines[-1, 1] / CHART_SIZE[1], 3.0, rtol=1e-6)  # lambda = 1e-3


@pytest.mark.rare
def test_volume_is_the_potential_in_the_body(tmp_path):
    """Voxel (k, j, i) holds 1 - V at its middle, of the potential learned from the joint's three coordinates."""
    run, rrd = make_run(n_frames=120, n_cameras=0), tmp_path / "r.rrd"
    write_recording(run, rrd)
    name = "L_elbow"
    spatial = joint_potentials(run.joints_m("body"), "body", run.tracks, run.skeleton)[name]
    path = f"{paths.joint(name, 'volume')}/potential"
    cell = column(rrd, path, "Volume3D:voxel_size")[2][0]
    corner = column(rrd, path, "Volume3D:translation")[2][0]
    cloud = make_layout(run).blocks[name]
    np.testing.assert_allclose(corner, cloud.corner_mm, rtol=1e-6)
    rng = np.random.default_rng(0)
    for k, j, i in rng.integers(0, cloud.value.shape, size=(20, 3)):
        middle_m = (corner + cell * (np.array([i, j, k]) + 0.5)) / 1000
        expected = spatial.potential.value(middle_m / spatial.scale_m)
        assert cloud.value[k, j, i] == pytest.approx(expected, abs=1e-5)
    now = column(rrd, f"{paths.joint(name, 'volume')}/now", "Points3D:positions")[2]
    np.testing.assert_array_equal(now, (run.data["joint_body"].values[:, 0] * 1000).astype(np.float32))


def test_report_is_the_text(run, rrd):
    """As it was handed over."""
    assert column(rrd, paths.REPORT, "TextDocument:text")[2].tolist() == [run.report_text]


@pytest.mark.rare
def test_same_run_same_recording(run, rrd, tmp_path):
    """Two writes hold the same data under the same identity; a millimetre on one marker makes another."""
    write_recording(run, tmp_path / "again.rrd")
    assert digest(tmp_path / "again.rrd") == digest(rrd)
    entry = RrdReader(str(rrd)).recordings()[0]
    assert (entry.application_id, entry.recording_id) == ("mocap", recording_id(run))
    xyz = run.xyz_m.copy()
    xyz[30, 2, 0] += 1e-3
    other = run.having(position=xyz)
    write_recording(other, tmp_path / "other.rrd")
    assert digest(tmp_path / "other.rrd") != digest(rrd)
    assert recording_id(other) != recording_id(run)


@pytest.mark.parametrize(("n_cameras", "n_joints"), [(0, 0), (0, 4), (1, 1), (30, 4)])
def test_any_number_of_cameras_and_joints(tmp_path, n_cameras, n_joints):
    """A view for each camera; no camera or joint tab where there is none; nothing that no view shows."""
    run = make_run(n_frames=12, n_cameras=n_cameras, n_joints=n_joints)
    write_recording(run, tmp_path / "r.rrd")
    tabs = [part.name for part in make_blueprint(make_layout(run)).root_container.contents]
    middle = ["Cameras"] * (n_cameras > 0) + ["Joints and potentials"] * (n_joints > 0)
    assert tabs == ["Angles and cycles", "Overview", *middle, "Filter diagnostics", "Report"]
    found = entities(tmp_path / "r.rrd")
    assert {paths.image(c.name) for c in run.cameras} <= found
    assert sum(path.startswith(paths.JOINTS) and path.endswith("/coordinates") for path in found) == n_joints


def test_gap_map_loses_no_class(tmp_path):
    """With more frames than columns a column has the colour of the worst of its frames; every frame is in one."""
    run = make_run(n_frames=1700, n_cameras=0, n_joints=0)
    write_recording(run, tmp_path / "r.rrd")
    colors = [palette.GROUND, *(palette.DIM_ORIGIN[name] for name in paths.ORIGINS)]
    n_markers = len(run.names)
    picture = column(tmp_path / "r.rrd", f"{paths.GAP_MAP}/samples", "Image:buffer")[2].reshape(n_markers, -1, 3)
    frame_columns = (np.arange(1700) * picture.shape[1]) // 1700
    rank = {Status.MISSING: 0, Status.MEASURED: 1, Status.SMOOTHED: 2, Status.REJECTED: 3}
    codes = np.vectorize(rank.get)(run.tracks.status)
    for m in range(n_markers):
        for c in range(0, picture.shape[1], 13):
            assert tuple(picture[m, c]) == colors[codes[frame_columns == c, m].max()]


def test_a_camera_that_goes_bad_is_a_bright_stretch_of_its_row(tmp_path):
    """In the map of residuals, and of innovations, a column has the colour of the rms of its frames."""
    run = make_run(n_frames=1700, n_cameras=6, n_joints=0)
    worse = run.innovation_px.copy()
    worse[4, 900:1000] *= 40
    run = run.having(innovation=worse)
    write_recording(run, tmp_path / "r.rrd")
    picture = column(tmp_path / "r.rrd", f"{paths.INNOVATION_MAP}/samples", "Image:buffer")[2].reshape(6, -1, 3)
    bright = picture.astype(int).sum(axis=-1)
    columns = np.arange(picture.shape[1]) * 1700 // picture.shape[1]
    bad = (columns > 905) & (columns < 995)
    assert (picture[4, bad] == palette.depth(np.zeros(1))).all()
    assert bright[4, (columns < 895) | (columns > 1005)].max() < bright[4, bad].min() - 60
    assert np.ptp(bright[[0, 1, 2, 3, 5]][:, bad].mean(axis=1)) < 30


def test_frames_with_nothing_to_see_are_left_out(tmp_path):
    """Where no marker has a position at either end, the recording starts later and keeps the numbers of the frames."""
    run = make_run(n_frames=60, n_cameras=2, n_joints=1)
    markers = run.tracks
    dark = np.r_[0:17, 50:60]
    xyz, cov, origin = markers.xyz_m.copy(), markers.cov_m2.copy(), markers.status.copy()
    xyz[dark], cov[dark], origin[dark] = np.nan, np.nan, Status.MISSING
    later = run.having(position=xyz, covariance=cov, status=origin)
    write_recording(later, tmp_path / "r.rrd")
    for entity, component, values in (
        (paths.SKELETON, "Points3D:positions", xyz),
        (f"{paths.image('cam2')}/reprojected", "Points2D:positions", run.reprojected_px[1]),
        (paths.ROWS, "Scalars:scalars", run.n_rows),
    ):
        frames, _, found = column(tmp_path / "r.rrd", entity, component)
        np.testing.assert_array_equal(frames, np.arange(17, 50))
        np.testing.assert_array_equal(found.ravel(), values[17:50].astype(found.dtype).ravel())
    times, _, _ = column(tmp_path / "r.rrd", paths.SKELETON, "Points3D:positions", index="time")
    np.testing.assert_array_equal(times, np.round(markers.t_s[17:50] * 1e9).astype(np.int64))


def test_nothing_known_is_a_recording_too(tmp_path):
    """No position of any marker, ever: no point, no path, a map without colour."""
    run = make_run(n_frames=4, n_cameras=2, n_joints=1)
    markers = run.tracks
    nothing = run.having(
        position=np.full_like(markers.xyz_m, np.nan),
        covariance=np.full_like(markers.cov_m2, np.nan),
        status=np.zeros_like(markers.status),
        reprojected=np.full_like(run.reprojected_px, np.nan),
    )
    write_recording(nothing, tmp_path / "r.rrd")
    assert np.isnan(column(tmp_path / "r.rrd", paths.SKELETON, "Points3D:positions")[2]).all()
    assert column(tmp_path / "r.rrd", paths.child(paths.MARKERS, "measured"), "Points3D:positions")[1].sum() == 0


@pytest.mark.parametrize("n_frames", [1, 2])
def test_shortest_runs(tmp_path, n_frames):
    """One frame is a recording too."""
    write_recording(make_run(n_frames=n_frames, n_cameras=2), tmp_path / "r.rrd")
    assert column(tmp_path / "r.rrd", paths.SKELETON, "Points3D:positions")[0].tolist() == list(range(n_frames))


def test_whole_or_not_at_all(run, tmp_path, monkeypatch):
    """Trouble on the way leaves the old file and no other."""
    (tmp_path / "r.rrd").write_text("old")

    def fail(*_: object) -> None:
        raise ValueError("in the middle")

    monkeypatch.setattr("mocap.rerun.tabs.health.log_gaps", fail)
    with pytest.raises(ValueError, match="in the middle"):
        write_recording(run, tmp_path / "r.rrd")
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("r.rrd", "old")]
    assert not rr.strict_mode()


@pytest.mark.rare
def test_thirty_cameras_are_small(tmp_path):
    """34 markers, 2000 frames, 30 cameras: not a fifth more than the numbers themselves."""
    run = make_run(n_frames=2000, n_cameras=30, n_joints=0, n_extra=16)
    write_recording(run, tmp_path / "r.rrd")
    n_used = run.used.sum()
    n_points = run.tracks.seen.sum()
    n_pixels = run.ideal_px[..., 0].size
    # float32 numbers: measured and reprojected pixels, whiskers; body, samples, trails, ellipsoids
    raw_bytes = 4 * (4 * n_pixels + 4 * n_used + n_points * (3 + 3 + 6 + 10))
    assert (tmp_path / "r.rrd").stat().st_size < 1.2 * raw_bytes
