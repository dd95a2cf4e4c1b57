"""Read a recording: tracks, their calibration and skeleton, and what is stated about them."""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from mocap.cameras.origin import PixelCorner
from mocap.io.format import Hints
from mocap.io.point_names import point_names
from mocap.pipeline.prepare import prepare
from mocap.pipeline.propose_skeleton import Proposal
from mocap.pipeline.propose_skeleton import propose_skeleton as propose
from mocap.pipeline.recording import Recording, load_skeleton

PathText = str | PathLike[str]


def read(
    tracks: PathText | Sequence[PathText],
    *,
    calibration: PathText | None = None,
    fps: float | None = None,
    unit: str | None = None,
    skeleton: PathText | None = None,
    profile: PathText | None = None,
    origin: PixelCorner | None = None,
    calibration_origin: PixelCorner | None = None,
    image_height_px: float | None = None,
    pixel_sd: float | None = None,
    stored_points: PathText | None = None,
    correct_lag: bool = False,
    crop: PathText | Sequence[PathText] | None = None,
    hints: Hints | None = None,
    mm_per_px: float | None = None,
    fit_lens: bool = False,
) -> Recording:
    """Read pixels or positions of any known format, with the calibration and skeleton that belong to them.

    The same options as ``mocap track`` takes. The result shows as a table in a notebook; ``mocap.track`` and
    ``mocap.learn`` take it.

    Args:
        tracks: Pixels or positions; a project of DLTdv8 holds its calibration too. Several files: the views of one
            trial, a camera each.
        calibration: DLT coefficients, calibration.toml, easyWand, ...; None: ``tracks`` holds it, or positions.
        fps: Frames a second, where the files do not hold it (or hold another).
        unit: Unit of lengths (m, mm, cm, in, ft), where the files do not state it.
        skeleton: Skeleton TOML: markers, bones, joints.
        profile: Camera profile, a line a camera.
        origin: Corner that pixel rows are counted from; None: found by the residual.
        calibration_origin: The same for the calibration, if it differs.
        image_height_px: Image height, to flip rows without a profile.
        pixel_sd: Standard deviation of a pixel; None: estimated.
        stored_points: xyzpts file to audit; None: the one beside ``tracks``.
        correct_lag: Read cameras that run late, by the audit, between their frames.
        crop: Crop offsets of cropped films, to be added to the pixels: a folder, or a file a camera in their order
            (MATLAB files with ``XYtop_left``, a row a frame; DeepLabCut's config.yaml or meta file; tables x,y). None:
            those beside the tracks with names that match, if rays then meet better.
        hints: How the file is to be read where it does not say so itself: its format, the columns of a plain table, the
            number of cameras of a sparse pixel file, the sheet of a workbook.
        mm_per_px: Millimetres a pixel of one film without a calibration; None: its positions stay pixels.
        fit_lens: Estimate radial distortion from the recording itself, and correct it; refused where it is not
            determined.

    Raises:
        FormatError: a file cannot be read.
        SkeletonError: the skeleton cannot be read, or names markers that the recording lacks.
        MocapError: the frame rate is in no file and not stated, or a number is out of all bounds.
    """

    def path(given: PathText | None) -> Path | None:
        return None if given is None else Path(given)

    def paths(given: PathText | Sequence[PathText] | None) -> tuple[Path, ...]:
        if given is None:
            return ()
        return (Path(given),) if isinstance(given, str | PathLike) else tuple(Path(one) for one in given)

    first, *views = paths(tracks) or (Path(),)
    recording = Recording(
        tracks=first,
        views=tuple(views),
        crop=paths(crop),
        calibration=path(calibration),
        fps=fps,
        unit=unit,
        skeleton=path(skeleton),
        profile=path(profile),
        pixel_origin=origin,
        calibration_origin=calibration_origin,
        image_height_px=image_height_px,
        pixel_sd=pixel_sd,
        stored_points=path(stored_points),
        correct_lag=correct_lag,
        hints=hints or Hints(),
        mm_per_px=mm_per_px,
        fit_lens=fit_lens,
    )
    load_skeleton(recording.skeleton, recording.contents.names)
    return recording


def propose_skeleton(recording: Recording, *, names: PathText | None = None) -> Proposal:
    """Propose bones, trunk and joints: which markers keep their distance, and where the chains of them bend.

    Write its ``text`` to a file, correct it, and read the recording with it.

    Args:
        recording: As ``read`` gives it; distances, angles and cycles, which decide, do not depend on the frame rate.
        names: What the points are called, in their order: a list, a name a line (DLTdv's ``pointnames.txt``), or a
            table of any known format that has them.

    Raises:
        MocapError: it shows too little, or there are not as many names as points.
    """
    given = recording.contents.names
    renamed = {} if names is None else dict(zip(given, point_names(Path(names), len(given)), strict=True))
    return propose(prepare(recording).in_space("a skeleton"), renamed=renamed)
