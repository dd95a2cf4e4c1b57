"""``mocap track`` of one calibrated camera with a model learned from other recordings."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from mocap.datasets.observe import Digitiser, lasting_errors
from mocap.filters.errors import FilterError
from mocap.filters.mixture import Mixture
from mocap.filters.model import LearnedModel
from mocap.filters.models.pose import PoseSettings
from mocap.filters.poses import MarkerTrial

import mocap
from eal.arrays import Z95
from mocap.errors import MocapError
from mocap.findings import Kind
from mocap.tracking.learning import Model
from mocap.tracking.one_camera import _told
from tests.filters.flapping_trials import BODY, FPS, MATRIX, NAMES, TRUNK, filmed, flapping
from tests.mocap.same import same_result


def model_of(*trials: MarkerTrial) -> Model:
    """A model learned from trials; how models are mixed does not matter here."""
    mixture = Mixture(
        offset=np.zeros(1),
        slope=np.zeros(1),
        length=np.array([10.0]),
        scale=np.ones((1, 1)),
        widen=1.0,
        dof=36.0,
    )
    return Model(
        LearnedModel(
            names=NAMES,
            trunk=TRUNK,
            bones=(),
            trials=trials,
            models=(PoseSettings(),),
            mixture=mixture,
            scores={},
        )
    )


def files_of(trial: MarkerTrial, hidden: slice, folder: Path, *, off_px: float = 0.0) -> tuple[Path, Path]:
    """Pixels of one camera that stay off, with a wing tip hidden for some frames, and its coefficients."""
    rng = np.random.default_rng(0)
    uv = filmed(trial, rng)[0]
    uv += lasting_errors(rng, (1, *uv.shape[:2]), Digitiser(lasting_px=off_px))[0]
    uv[hidden, NAMES.index("tip_l")] = np.nan
    head = ",".join(f"{name}_cam1_{axis}" for name in NAMES for axis in "XY")
    rows = [",".join("NaN" if np.isnan(x) else f"{x:.3f}" for x in row) for row in uv.reshape(len(uv), -1)]
    tracks, coefficients = folder / "film_xypts.csv", folder / "film_dltCoefs.csv"
    tracks.write_text("\n".join([head, *rows]) + "\n")
    matrix = MATRIX.copy()
    matrix[:, 3] += MATRIX[:, :3] @ [0.0, 0.0, 1.0]  # its centre is at z = -1: DLT cannot have it at the origin
    np.savetxt(coefficients, (matrix / matrix[2, 3]).ravel()[:11, None])
    return tracks, coefficients


@pytest.fixture(scope="module")
def learned() -> Model:
    """From three trials."""
    return model_of(*(flapping(k) for k in (1, 2, 3)))


@pytest.fixture
def files(tmp_path):
    """With a wing tip hidden for 20 frames."""
    return files_of(flapping(9), slice(50, 70), tmp_path)


def read(files, **stated):
    """The recording."""
    return mocap.read(files[0], calibration=files[1], fps=FPS, unit="m", **stated)


def test_positions_statuses_and_velocities_are_there_as_from_many_cameras(files, learned, tmp_path):
    """Positions within 2 % of the distance, a gap that is smoothed, kinematics with deviations; loaded, the same."""
    found = mocap.track(read(files), model=learned)
    tracked = found.tracks
    truth = flapping(9).xyz_m - [0.0, 0.0, 1.0]
    error = np.linalg.norm(tracked.xyz_m - truth, axis=-1)
    assert np.nanmedian(error) < 0.03
    tip = NAMES.index("tip_l")
    assert (tracked.status[50:70, tip] == 4).all()
    assert (tracked.status[:50, tip] == 1).all()
    assert np.isfinite(found.motion.velocity_m_s[1:-1]).all()
    assert any("one camera alone" in said for said in found.report["findings"])
    assert "size of the animal is the model's" in found.report["model"]["why"]
    for word in ("repeatability", "in 3D", "where they were measured"):  # no point was measured
        assert word not in found.report_text
    (tmp_path / "result").mkdir()
    found.write(tmp_path / "result", pictures=False)
    same_result(found, mocap.load(tmp_path / "result"))


def test_wider_intervals_and_a_single_trial_are_said():
    """Three of four frames are widened, by an RMS of sqrt((1.5^2 + 2 * 3^2) / 3) = 2.598; of none nothing is said."""
    wider = np.array([1.0, 1.5, 3.0, 3.0])
    one, two = (_told(None, 0, wider, trials=trials, loose=False) for trials in (1, 2))
    numbers = {finding.kind: finding.numbers for finding in one}
    assert numbers["wider intervals"] == pytest.approx({"share": 0.75, "times": 2.598, "most": 3.0}, abs=5e-4)
    assert "75% of the frames are 2.60 times as large" in str(one[1])
    assert {finding.kind for finding in one} - {finding.kind for finding in two} == {"one trial"}
    assert [finding.kind for finding in _told(None, 0, np.ones(4), trials=2, loose=False)] == ["one camera"]


def test_clicks_that_stay_off_are_told_and_widen_intervals(learned, tmp_path):
    """By 12 px, of 0.5 px from frame to frame: found, said in the report, no frame is empty and intervals hold.

    Depth, which is one error for all of so short a trial, may be outside.
    """
    trial = flapping(9, frames=50)
    recording = read(files_of(trial, slice(0, 0), tmp_path, off_px=12.0))
    found = mocap.track(recording, model=learned, validate=False)
    told = next(one for one in found.findings if one.kind is Kind.MISFIT)
    assert told.numbers["sd_px"] == pytest.approx(12.0, rel=0.5)
    assert f"by {told.numbers['sd_px']:.2g} px" in found.report_text
    error = found.tracks.xyz_m - (trial.xyz_m - [0.0, 0.0, 1.0])
    sd = np.sqrt(np.einsum("tmii->tmi", found.tracks.cov_m2))
    assert np.isfinite(error).all()
    assert np.mean((np.abs(error) < Z95 * sd)[..., :2]) > 0.9


def test_without_a_model_it_says_what_to_do(files):
    """One line."""
    with pytest.raises(MocapError, match=r"contains one camera: .*\(mocap learn\): give `model`"):
        mocap.track(read(files))


def test_a_model_of_another_rate_is_refused(files, learned):
    """Its motion would be wrong by the ratio."""
    recording = mocap.read(files[0], calibration=files[1], fps=2 * FPS, unit="m")
    with pytest.raises(FilterError, match="share a frame rate"):
        mocap.track(recording, model=learned)


@pytest.mark.parametrize("option", ["fit_lens", "correct_lag"])
def test_what_needs_rays_that_meet_is_refused(files, option):
    """The lens of one camera cannot be fitted to its own pixels, with its calibration and without."""
    for read_one in (partial(read, files), partial(mocap.read, files[0], fps=FPS)):
        with pytest.raises(MocapError, match=f"`{option}`: needs markers that two cameras see"):
            read_one(**{option: True})


def swinging(seed: int, turn: np.ndarray) -> MarkerTrial:
    """A trunk whose six limb markers swing along x alone, each by itself, before a camera that ``turn`` (3, 3) aims."""
    rng, t = np.random.default_rng(seed), np.arange(120) / FPS
    xyz = np.zeros((len(t), len(NAMES), 3))
    xyz[:, :4] = BODY
    for k in range(6):
        xyz[:, 4 + k] = [0.04 * (k // 2 - 1), 0.05 * (-1) ** k, -0.05]
        for _ in range(2):
            xyz[:, 4 + k, 0] += 0.03 * np.sin(2 * np.pi * (rng.uniform(1, 6) * t + rng.uniform()))
    xyz += np.column_stack([0.3 * t, 0.05 * np.sin(3 * t), 0 * t])[:, None] + 3e-4 * rng.normal(size=xyz.shape)
    return MarkerTrial(
        name=f"trial{seed}", t_s=t, xyz_m=xyz @ turn.T + [0.0, 0.0, 1.5], sd_m=np.full(xyz.shape[:2], 3e-4)
    )


ACROSS = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""The camera looks along y, and sees the swing as it is."""
ALONG = np.array([[0, 1.0, 0], [0, 0, -1], [-1, 0, 0]])
"""It looks along x, the swing: it lies in every plane of the motion."""


@pytest.mark.rare
@pytest.mark.parametrize(("turn", "poor"), [(ACROSS, False), (ALONG, True)])
def test_a_view_along_the_motion_is_said_to_tell_little(tmp_path, turn, poor):
    """Limbs that swing along the line of sight are known from trials alone; across it the same limbs are seen.

    What is stated of the poor view is what it errs by: within a third of the error of the fourth trial.
    """
    trial = swinging(9, turn)
    files = files_of(trial, slice(0, 0), tmp_path)
    found = mocap.track(read(files), model=model_of(*(swinging(k, np.eye(3)) for k in (1, 2, 3))), validate=False)
    said = [one for one in found.findings if one.kind == "poor view"]
    assert bool(said) == poor
    if said:
        error = found.tracks.xyz_m - (trial.xyz_m - [0.0, 0.0, 1.0])
        relative = error - np.nanmean(error, axis=1, keepdims=True)
        rms = np.sqrt(np.nanmean(np.sum(relative**2, axis=-1)))
        assert said[0].numbers["error_m"] == pytest.approx(rms, rel=1 / 3)
