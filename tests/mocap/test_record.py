"""A recording is one Dataset with declared variables, cleaned by one verb, which ``track`` takes as it is."""

import numpy as np
import pytest
import xarray as xr
from mocap.datasets import make_bat

import mocap
from mocap.cleaning.cleaned import SINCE_CLEAN, Cleaned, written
from mocap.errors import MocapError
from mocap.records import Status
from mocap.variables import VARIABLES


def wrong_at(film):
    """A frame in which all cameras see the marker."""
    return int(np.flatnonzero(film.pixels.seen[:, :, 5].all(axis=0))[10])


@pytest.fixture(scope="module")
def bat():
    film = make_bat(seed=2, n_frames=60, n_cameras=3)
    uv = np.array(film.pixels.uv_px)
    uv[:, 20:30, 4] = np.nan
    uv[0, wrong_at(film), 5] += 200.0
    return mocap.from_pixels(uv, film.cameras, names=film.pixels.names, fps=film.fps, unit="m", skeleton=film.skeleton)


def declared(recording):
    for name, found in recording.data.data_vars.items():
        told = VARIABLES[name]
        assert found.dims == told.dims
        assert found.attrs.get("units", "") == told.unit
        assert not found.values.flags.writeable


def test_each_step_adds_the_variables_that_are_declared(bat):
    """Read: pixels, and ideal ones; cleaned: the rest; as they are declared, and not to be written into."""
    assert set(bat.data.data_vars) == {"pixels", "ideal"}
    done = mocap.clean(bat)
    others = {"late", "likelihood", "confidence", "lens_covariance", "edited", "by_hand", "overruled"}
    assert set(done.data.data_vars) | others == {name for name, one in VARIABLES.items() if one.since != "track"}
    declared(bat)
    declared(done)
    assert set(bat.data.data_vars) == {"pixels", "ideal"}, "the first one stays as it was"
    assert mocap.clean(done) is done


def test_all_that_is_declared_since_clean_is_written_at_once(bat):
    """By the one writer: what it is given makes the recording that ``clean`` gives, and nothing may be left out."""
    done = mocap.clean(bat)
    given = {name: done.data[name].values for name in SINCE_CLEAN & {*done.data} - {"rejected", "repaired"}}
    positions = {name: done.data[name].values for name in ("position", "covariance", "ideal")}
    again = written(bat, done[Cleaned], rejected=done.rejected, **given, **positions)
    xr.testing.assert_identical(again.data, done.data[list(again.data)])
    assert set(again.data) == set(done.data)
    for name in given:
        rest = {other: values for other, values in given.items() if other != name}
        with pytest.raises(ValueError, match=f"^{name} is missing"):
            written(bat, Cleaned(), rejected=done.rejected, **positions, **rest)
    with pytest.raises(ValueError, match=r"^rejected is missing"):
        written(bat, Cleaned(), **positions, **given)
    for name in ("status", "repaired", "nis"):
        with pytest.raises(ValueError, match=f"{name}: follows from the rest, or is not written by cleaning"):
            written(done, done[Cleaned], **{name: np.zeros(3)})


def test_what_is_not_believed_says_so_and_why(bat):
    """A click 20 cm off leaves its ray rejected; hidden samples are missing; the rest is measured, with its noise."""
    done = mocap.clean(bat)
    status = done.data["status"].values
    assert (status[20:30, 4] == Status.MISSING).all()
    assert done.data["ray_rejected"].values[0, wrong_at(make_bat(seed=2, n_frames=60, n_cameras=3)), 5]
    known = np.isfinite(done.data["position"].values[..., 0])
    np.testing.assert_array_equal(known, status == Status.MEASURED)
    np.testing.assert_array_equal(done.data["rejected"].any("reason").values & ~known, status == Status.REJECTED)
    assert (np.linalg.eigvalsh(done.data["covariance"].values[known]) > 0).all()


@pytest.mark.rare
def test_what_was_cleaned_is_tracked_as_what_was_not(bat):
    """The same numbers to the last digit."""
    one, other = (mocap.track(x, model="constant_velocity", validate=False) for x in (bat, mocap.clean(bat)))
    np.testing.assert_array_equal(one.markers["position"].values, other.markers["position"].values)
    assert one.report["findings"] == other.report["findings"]


def test_positions_are_cleaned_too():
    """A jump of half a metre is rejected; a table keeps its rate and unit."""
    t = np.arange(80) / 100
    xyz = np.stack([np.stack([np.sin(t + k), np.cos(t) + k, t], axis=1) for k in range(3)], axis=1)
    xyz += 1e-4 * np.random.default_rng(0).standard_normal(xyz.shape)
    xyz[40, 1] += 0.5
    done = mocap.clean(mocap.from_arrays(xyz, fps=100, unit="m"))
    declared(done)
    assert done.data["status"].values[40, 1] == Status.REJECTED
    assert done.data["rejected"].sel(reason="jump").values[40, 1]
    assert "believed" in done.summary()
    with pytest.raises(MocapError, match=r"mocap\.clean takes a recording, not ndarray.*mocap\.from_arrays"):
        mocap.clean(xyz)


def test_a_dataset_is_written_and_read_by_xarray(bat, tmp_path):
    """No private writer: NetCDF as xarray makes it, with every variable."""
    done = mocap.clean(bat)
    done.data.to_netcdf(tmp_path / "clean.nc")
    with xr.open_dataset(tmp_path / "clean.nc") as back:
        for name in done.data.data_vars:
            np.testing.assert_array_equal(back[name].values.astype(float), done.data[name].values.astype(float))
