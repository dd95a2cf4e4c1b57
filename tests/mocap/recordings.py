"""Recordings for tests: random ones with awkward names, and hypothesis strategies of them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from hypothesis import strategies as st
from mocap.datasets.film import SyntheticRecording

from mocap.io.contents import FileContents, pixel_recording, point_recording
from mocap.records import Status
from mocap.skeleton import Skeleton

NAMES = st.text(st.characters(exclude_categories=("C", "Z")) | st.sampled_from(" ,;.:'\"-_"), min_size=1, max_size=12)
"""Letters of any script, spaces, commas and quotes; no line ends or tabs."""
PLACES = st.sampled_from([0.0, 1.0, -0.0005, 1e-3]) | st.floats(-50, 50, allow_subnormal=False)


def names_of(count: int) -> st.SearchStrategy[list[str]]:
    """Names that a reader cannot take for others: no spaces around them."""
    return st.lists(NAMES.map(str.strip).filter(bool), min_size=count, max_size=count, unique=True)


@st.composite
def point_recordings(draw: st.DrawFn, *, names: st.SearchStrategy[list[str]] | None = None) -> FileContents:
    """Positions in metres, some at exactly (0, 0, 0), some missing, maybe all, of any origin."""
    n_markers, n_frames = draw(st.integers(1, 4)), draw(st.integers(1, 5))
    own = draw(names if names is not None else names_of(n_markers))
    size = n_frames * n_markers
    xyz = np.array(draw(st.lists(PLACES, min_size=3 * size, max_size=3 * size))).reshape(n_frames, n_markers, 3)
    codes = draw(st.lists(st.sampled_from([0, 1, 2, 3, 4]), min_size=size, max_size=size))
    origin = np.array(codes).reshape(n_frames, n_markers)
    zero = np.array(draw(st.lists(st.booleans(), min_size=size, max_size=size))).reshape(n_frames, n_markers)
    xyz[zero & draw(st.booleans())] = 0.0
    xyz[origin == Status.MISSING] = np.nan
    return points(own, xyz, origin=origin, first=draw(st.sampled_from([1, 7, 1914])))


def points(names: list[str], xyz_m: np.ndarray, *, origin: np.ndarray | None = None, first: int = 1) -> FileContents:
    """Positions in metres at 250 frames a second, the first frame called ``first``."""
    frames = first + np.arange(len(xyz_m))
    return point_recording(
        Path("made.csv"), "made", names=names, xyz=xyz_m, unit="m", frames=frames, first=1, fps=250.0, status=origin
    )


@st.composite
def pixel_recordings(draw: st.DrawFn) -> FileContents:
    """Pixels of one to three cameras, with and without scores."""
    n_markers, n_frames, n_cameras = draw(st.integers(1, 4)), draw(st.integers(1, 5)), draw(st.integers(1, 3))
    size = n_frames * n_markers * n_cameras
    uv = np.array(draw(st.lists(st.floats(0, 3000), min_size=2 * size, max_size=2 * size)))
    uv = uv.reshape(n_cameras, n_frames, n_markers, 2)
    lost = np.array(draw(st.lists(st.booleans(), min_size=size, max_size=size))).reshape(uv.shape[:3])
    uv[lost] = np.nan
    score = np.where(lost, 0.25, 0.75) if draw(st.booleans()) else None
    return pixel_recording(
        Path("made.csv"),
        "made",
        names=draw(names_of(n_markers)),
        cameras=[f"cam{c + 1}" for c in range(n_cameras)],
        uv_px=uv,
        fps=250.0,
        score=score,
    )


def with_markers(made: SyntheticRecording, names: Sequence[str]) -> SyntheticRecording:
    """A made recording of which some markers are digitised: pixels, truth and skeleton of these alone."""
    some = [made.truth.names.index(name) for name in names]
    truth, whole, known = made.truth, made.skeleton, set(names)
    return replace(
        made,
        **{name: getattr(made, name)[..., some] for name in ("occluded", "lost", "outlier", "contact")},
        pixels=replace(made.pixels, names=tuple(names), uv_px=made.pixels.uv_px[:, :, some]),
        truth=replace(
            truth,
            names=tuple(names),
            xyz_m=truth.xyz_m[:, some],
            cov_m2=truth.cov_m2[:, some],
            status=truth.status[:, some],
        ),
        skeleton=Skeleton(
            name=whole.name,
            markers=tuple(names),
            bones=tuple(bone for bone in whole.bones if {bone.a, bone.b} <= known),
            joints=tuple(joint for joint in whole.joints if {joint.parent, joint.centre, joint.child} <= known),
            trunk=tuple(marker for marker in whole.trunk if marker in known),
            max_speed_m_s=whole.max_speed_m_s,
        ),
    )
