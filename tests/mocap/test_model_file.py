"""Files of learned models: kept whole, or refused in one line."""

import contextlib
import json
from dataclasses import asdict, fields, replace

import numpy as np
import pytest
from mocap.filters.models.constant_velocity import MarkerSettings
from mocap.filters.models.pose import PoseSettings

from mocap.errors import FormatError
from mocap.tracking.model_file import load_model, save_model
from tests.filters.small_model import same, small_model


@pytest.fixture
def small():
    return small_model()


def test_every_choice_is_kept(small, tmp_path):
    """Settings of all kinds come back as they were: numbers, ranks, names."""
    kind = PoseSettings(
        ranks=(1, 7),
        potential="none",
        bones=1 / 3,
        process_noise=1e-7,
        covariance=(0.1, -1 / 3),
    )
    three = small.mixture
    mixture = replace(three, offset=np.array([0.1, -1 / 3]), slope=np.array([0.0, 1e-300]), scale=np.ones((1, 2)))
    path = tmp_path / "m.npz"
    save_model(replace(small, models=(MarkerSettings(acceleration=0.1), kind), mixture=mixture), path)
    again = load_model(path)
    assert again.models == (MarkerSettings(acceleration=0.1), kind)
    assert asdict(again.models[1]) == asdict(kind)
    assert same(again.mixture, mixture)


def test_damaged_files_are_refused(small, tmp_path):
    """Cut anywhere or with a byte changed anywhere: what loads is the same model, everything else is a FormatError."""
    path = tmp_path / "m.npz"
    save_model(small, path)
    whole = path.read_bytes()
    broken = tmp_path / "broken.npz"
    refused = 0
    for at in np.linspace(0, len(whole) - 1, 60).astype(int):
        changed = whole[:at] + bytes([whole[at] ^ 0x55]) + whole[at + 1 :]
        for content in (whole[:at], changed):
            broken.write_bytes(content)
            with contextlib.suppress(FormatError):
                again = load_model(broken)
                assert all(same(getattr(small, f.name), getattr(again, f.name)) for f in fields(small))
                continue
            refused += 1
    assert refused > 100


def rewritten(path, folder, **changed):
    """A copy of a model file with arrays replaced; None leaves one out."""
    with np.load(path) as file:
        arrays = {**dict(file), **changed}
    target = folder / "changed.npz"
    np.savez(target, **{name: array for name, array in arrays.items() if array is not None})
    return target


@pytest.mark.parametrize(
    "changed",
    [
        {"header": None},
        {"header": np.array("not json")},
        {"header": np.array("[1, 2]")},
        {"header": np.array('{"format": "eal-mocap model 12"}')},
        {"trial_0_xyz_m": None},
        {"trial_0_xyz_m": np.zeros((40, 4, 3))},
        {"trial_0_sd_m": np.zeros(40)},
        {"trial_0_t_s": np.zeros(39)},
        {"mixture_offset": np.zeros(3)},
        {"mixture_length": np.zeros(1)},
    ],
    ids=lambda changed: "".join(f"{k}:{getattr(v, 'shape', v)}" for k, v in changed.items()),
)
def test_foreign_files_are_refused(small, tmp_path, changed):
    """Archives that lack something, or whose parts contradict each other: one line that names the file."""
    path = tmp_path / "m.npz"
    save_model(small, path)
    target = rewritten(path, tmp_path, **changed)
    with pytest.raises(FormatError, match="not a model that mocap learn wrote") as caught:
        load_model(target)
    assert str(target) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_other_versions_and_other_files_are_named(small, tmp_path):
    """A later format is said to be one; text, an array, a folder and nothing at all are no models."""
    path = tmp_path / "m.npz"
    save_model(small, path)
    with np.load(path) as file:
        header = {**json.loads(str(file["header"])), "format": "eal-mocap model 13"}
    with pytest.raises(FormatError, match="expected 'eal-mocap model 12', but it says 'eal-mocap model 13': learn it"):
        load_model(rewritten(path, tmp_path, header=np.array(json.dumps(header))))
    (tmp_path / "text.npz").write_text("pt1_X,pt1_Y\n1,2\n")
    np.save(tmp_path / "array.npy", np.arange(3))
    for name in ("text.npz", "array.npy", ""):
        with pytest.raises(FormatError, match="not a model"):
            load_model(tmp_path / name)
    with pytest.raises(FormatError, match=r"nowhere\.npz: there is no such file"):
        load_model(tmp_path / "nowhere.npz")
