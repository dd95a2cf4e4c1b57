"""The lens of one camera from its views of a board; the lens model is chosen on images left out of the fit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from eal.arrays import Array
from mocap.calibration.boards import Corners
from mocap.calibration.bundle import adjust
from mocap.calibration.scene import CLICK_PX, Adjusted, Free, RigCamera, RigScene, Sightings, distinct
from mocap.cameras.lens import BrownLens, FisheyeLens, Lens, RationalLens
from mocap.errors import CalibrationError
from mocap.text import number_of

OUTLYING = 4.0
"""An image misses by so many times what the median image does: its corners are not those of the board. Of 78 images of
four real cameras the worst misses by 1.6 times."""
SHARP_PX = 0.05
"""No image that misses by less is outlying: rendered corners of sharp boards are found to a hundredth or two."""
FEWEST_PICTURES = 5
"""Three determine focal lengths and centre (Zhang 2000), the other two what they err by."""
CHOICES: dict[str, tuple[type[Lens], tuple[bool, ...]]] = {
    "brown2": (BrownLens, (True, True, False, False, False)),
    "brown": (BrownLens, (True,) * 5),
    "fisheye": (FisheyeLens, (True,) * 4),
    "rational": (RationalLens, (True,) * 8),
}
"""Lens models that are tried, and which of their coefficients are free: Brown's first, which every format holds."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Intrinsics:
    """A lens, and the evidence for it.

    Attributes:
        lens: The lens.
        choice: Its name in ``CHOICES``.
        held_out_px: Root mean square error on images that were not used for the fit, by choice; inf where a model
            failed; empty where the lens was known, or the one choice cannot be fitted without some images.
        f_sd_px: Standard deviation of its focal length.
        cov: (k, k) covariance of fx, fy, cx, cy and the free coefficients; errors of one image go together.
        rms_px: Root mean square error on all images that were used.
        image_px: Root mean square error of each image, also of those left out, whose boards are placed with the lens.
        left_out: Why images were not used, by their number.
    """

    lens: Lens
    choice: str
    held_out_px: dict[str, float]
    f_sd_px: float
    rms_px: float
    cov: Array
    image_px: tuple[float, ...] = ()
    left_out: Mapping[int, str] = field(default_factory=dict)

    @property
    def free(self) -> tuple[int, ...]:
        """Which numbers of the lens ``cov`` is of: fx, fy, cx, cy are 0 to 3, coefficients follow."""
        if self.choice not in CHOICES:
            return ()
        return (0, 1, 2, 3, *(4 + i for i, moves in enumerate(CHOICES[self.choice][1]) if moves))


def fit_intrinsics(
    views: Sequence[Corners],
    size_px: tuple[int, int],
    *,
    name: str,
    choices: Sequence[str] = tuple(CHOICES),
) -> Intrinsics:
    """Fit lens models and choose.

    Every model is fitted with a quarter of the images left out, whose boards are then placed with that lens; what is
    left there counts (each corner's error up to five median ones, so that a corner found wrongly does not choose). The
    first model is taken that no other beats by more than 3 % and by one standard error over the images; a lens
    that folds in the corners of the image only where every other is 5 % worse. An image that misses by four times what
    the median one does is left out, and the rest fitted again, as long as three quarters stay.

    Args:
        views: Corners of the images.
        size_px: Their size.
        name: Of the camera, for messages.
        choices: Names in ``CHOICES``.

    Raises:
        CalibrationError: too few images, or no model gives a lens that can be.
    """
    if len(views) < FEWEST_PICTURES:
        raise CalibrationError(
            f"camera {name!r}: the board was found in {number_of(len(views), 'image')}, and {FEWEST_PICTURES} are "
            "needed: film it at more places and tilts"
        )
    kept, left_out = list(range(len(views))), dict[int, str]()
    while True:
        found = _fitted([views[i] for i in kept], size_px, name, choices)
        own = np.array([_image_px(views[i], found.lens) for i in kept])
        usual, worst = float(np.median(own)), int(np.argmax(own))
        if not own[worst] > max(OUTLYING * usual, SHARP_PX) or len(kept) <= max(FEWEST_PICTURES, 0.75 * len(views)):
            break
        left_out[kept.pop(worst)] = (
            f"its corners miss by {own[worst]:.2f} px, those of the median image by {usual:.2f} px: the board was "
            "found wrongly, moved during the exposure, or is another"
        )
    image_px = tuple(_image_px(view, found.lens) for view in views)
    return replace(found, image_px=image_px, left_out=left_out)


def _image_px(corners: Corners, lens: Lens) -> float:
    """Root mean square error of an image's corners, its board placed with a lens; inf where it cannot be."""
    squares = _placed_squares(corners, lens)
    return float("inf") if squares is None else float(np.sqrt(squares.mean()))


def _fitted(views: Sequence[Corners], size_px: tuple[int, int], name: str, choices: Sequence[str]) -> Intrinsics:
    """The lens of all of some images; as ``fit_intrinsics``, which says which they are."""
    fits, errors, failures = {}, {}, []
    for choice in choices:
        try:
            fits[choice] = _fit(views, size_px, choice, name)
            errors[choice] = _held_out(views, size_px, choice, name)
        except CalibrationError as error:
            failures.append(str(error))
            if len(choices) > 1:
                fits.pop(choice, None)
    if not fits:
        raise CalibrationError(failures[0])
    (choice, *others) = fits
    if others:
        choice = _chosen({c: (np.sqrt(errors[c]), without_ray(_lens(fits[c]), size_px)) for c in fits})
    return Intrinsics(
        lens=_lens(fits[choice]),
        choice=choice,
        held_out_px={c: float(np.sqrt(np.mean(errors[c]))) if c in errors else float("inf") for c in choices}
        if errors
        else {},
        f_sd_px=float(fits[choice].f_sd_px[0]),
        rms_px=float(np.sqrt(np.mean(np.sum(fits[choice].error_px ** 2, axis=-1)))),
        cov=fits[choice].lens_cov[0],
    )


def _held_out(views: Sequence[Corners], size_px: tuple[int, int], choice: str, name: str) -> Array:
    """(n,) mean squared error of each image with a lens that was fitted without it."""
    shape = [np.append(v.uv_px.mean(axis=0), v.uv_px.std(axis=0)) for v in views]
    pose = distinct(np.stack(shape), within=CLICK_PX)  # images of a board that lies still are left out together
    if not pose.any():
        raise CalibrationError(f"camera {name!r}: the board lies still in all images: film it at more places and tilts")
    part = pose % min(4, pose.max() + 1)
    out = np.empty(len(views))
    for fold in range(part.max() + 1):
        lens = _lens(_fit([v for v, p in zip(views, part, strict=True) if p != fold], size_px, choice, name))
        for i in np.flatnonzero(part == fold):
            out[i] = _placed_error(views[int(i)], lens)
    return out


def _chosen(models: dict[str, tuple[Array, float]]) -> str:
    """The first model that none beats clearly; one that has a ray for every pixel, where it costs at most 5 %.

    Args:
        models: Each image's held-out error, and the share of the image without a ray; the preferred first.
    """
    level = {c: float(np.sqrt(np.mean(e**2))) for c, (e, _) in models.items()}
    best = min(level, key=lambda c: level[c])
    whole = [c for c, (_, lost) in models.items() if lost == 0 and level[c] <= 1.05 * level[best]]
    best = min(whole or [best], key=lambda c: level[c])
    for c, (error, lost) in models.items():
        gain = error - models[best][0]
        alike = level[c] < 1.03 * level[best] or gain.mean() < gain.std() / np.sqrt(len(gain))
        if c == best or (alike and lost <= models[best][1]):
            return c
    return best


def _lens(adjusted: Adjusted) -> Lens:
    return adjusted.scene.cameras[0].lens


def place(corners: Corners, lens: Lens) -> tuple[Array, Array] | None:
    """Rotation (3, 3) and translation (3,) that take a board to the camera's axes (``solvePnP``, then refined).

    None where no placement in front of the camera is found.
    """
    ideal = lens.undistort(corners.uv_px)
    ok = np.isfinite(ideal).all(axis=-1)
    if np.count_nonzero(ok) < 6:
        return None
    xy = np.ascontiguousarray(lens.normalised(ideal[ok]))
    found, rotations, translations, errors = cv2.solvePnPGeneric(
        corners.local_m[ok], xy, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    if not found:
        return None
    best = int(np.argmin(np.ravel(errors)))
    rvec, tvec = cv2.solvePnPRefineLM(corners.local_m[ok], xy, np.eye(3), None, rotations[best], translations[best])
    if not tvec[2, 0] > 0:
        return None
    return np.asarray(cv2.Rodrigues(rvec)[0], dtype=float), np.ravel(tvec).astype(float)


def _placed_squares(corners: Corners, lens: Lens) -> Array | None:
    """(n,) squared errors of an image's corners, its board placed with a lens; None where it cannot be."""
    placed = place(corners, lens)
    if placed is None:
        return None
    at = RigCamera(name="", lens=lens, rotation=placed[0], translation_m=placed[1])
    return np.sum((corners.uv_px - at.record(corners.local_m)) ** 2, axis=-1)


def _placed_error(corners: Corners, lens: Lens) -> float:
    """Mean squared error of an image's corners, its board placed with a lens; errors count up to five medians."""
    squares = _placed_squares(corners, lens)
    return float("inf") if squares is None else float(np.minimum(squares, 25 * np.median(squares)).mean())


def _fit(views: Sequence[Corners], size_px: tuple[int, int], choice: str, name: str) -> Adjusted:
    """One model fitted to images: Zhang's focal length, one coefficient, then all of them.

    Raises:
        CalibrationError: boards cannot be placed, or the lens is none that can be.
    """
    model, free = CHOICES[choice]
    fisheye = model is FisheyeLens
    first: type[Lens] = FisheyeLens if fisheye else BrownLens
    middle = ((size_px[0] - 1) / 2, (size_px[1] - 1) / 2)
    # Zhang's closed form, the principal point in the middle; a guess where that fails
    boards, pixels = ([getattr(v, of).astype(np.float32) for v in views] for of in ("local_m", "uv_px"))
    f = float(cv2.initCameraMatrix2D(boards, pixels, size_px)[0, 0])
    f = f if 0.2 * max(size_px) < f < 100 * max(size_px) else 1.2 * max(size_px)
    f = min(f, 0.8 * max(size_px)) if fisheye else f
    lens = first.of((f, f), middle, np.zeros(first.n_coefficients))
    one = (True, *[False] * (first.n_coefficients - 1))
    lens = _moved(views, lens, Free(focal="one", centre=False, coefficients=(one,), orientation=True), choice, name)[1]
    start = np.pad(lens.coefficients, (0, model.n_coefficients - first.n_coefficients))
    lens = model.of(lens.f_px, lens.centre_px, start)
    adjusted, lens = _moved(views, lens, Free(coefficients=(free,), orientation=True), choice, name)
    trouble = lens_trouble(lens, size_px)
    reach = np.concatenate([v.uv_px for v in views])
    if trouble is None and np.isnan(lens.undistort(reach)).any():
        trouble = "cannot be inverted where the board was seen (its distortion is too strong)"
    if trouble:
        raise CalibrationError(f"camera {name!r}: a {choice} lens {trouble}: film the board at more places and tilts")
    return adjusted


def _moved(views: Sequence[Corners], lens: Lens, free: Free, choice: str, name: str) -> tuple[Adjusted, Lens]:
    placed = [(v, p) for v in views if (p := place(v, lens)) is not None]
    if len(placed) < FEWEST_PICTURES - 2:
        raise CalibrationError(f"camera {name!r}: the position of the boards cannot be found with a {choice} lens")
    count = [len(v.ids) for v, _ in placed]
    sightings = Sightings(
        camera=np.zeros(sum(count), int),
        body=np.repeat(np.arange(len(placed)), count),
        local_m=np.concatenate([v.local_m for v, _ in placed]),
        uv_px=np.concatenate([v.uv_px for v, _ in placed]),
    )
    scene = RigScene(
        cameras=(RigCamera(name=name, lens=lens, rotation=np.eye(3), translation_m=np.zeros(3)),),
        rotation=np.stack([p[0] for _, p in placed]),
        position_m=np.stack([p[1] for _, p in placed]),
    )
    adjusted = adjust(scene, sightings, free=free)
    return adjusted, adjusted.scene.cameras[0].lens


def without_ray(lens: Lens, size_px: tuple[int, int]) -> float:
    """Share of an image that no ray reaches, because the lens folds there (boards were not filmed so far out)."""
    u, v = np.meshgrid(np.linspace(0, size_px[0] - 1, 41), np.linspace(0, size_px[1] - 1, 41))
    return float(np.isnan(lens.undistort(np.stack([u, v], axis=-1))[..., 0]).mean())


def lens_trouble(lens: Lens, size_px: tuple[int, int]) -> str | None:
    """Why a lens cannot be that of images of a size; None where it can. The limits are chosen, not measured."""
    share = np.asarray(lens.centre_px) / np.asarray(size_px)
    if (np.abs(share - 0.5) > 0.3).any():
        return f"has its principal point at ({lens.centre_px[0]:.0f}, {lens.centre_px[1]:.0f}) px, far from the middle"
    aspect = lens.f_px[1] / lens.f_px[0]
    if not 0.8 < aspect < 1.25:
        return f"has pixels {aspect:.2f} times as wide as high"
    if not 0.15 * max(size_px) < lens.f_px[0] < 100 * max(size_px):
        return f"has a focal length of {lens.f_px[0]:.0f} px for images {max(size_px)} px wide"
    return None
