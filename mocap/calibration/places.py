"""Where cameras with known lenses stand, from known points clicked in each camera's image."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import least_squares

from eal.arrays import Array
from mocap.calibration.scene import RigCamera, distinct, turn, turned_rad
from mocap.cameras.camera import KnownLens
from mocap.errors import CalibrationError

FEWEST_POINTS = 4  # three leave up to four poses (Grunert 1841), a fourth says which


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedCamera:
    """A camera's position and orientation, and how well they are known.

    Attributes:
        camera: The camera.
        error_px: (P, 2) recorded minus predicted pixels of all points; NaN where not clicked.
        left_out: Numbers of the points that agree with no place that fits the others, and were not used.
        sd_px: Standard deviation of a clicked coordinate.
        freedom: Degrees of freedom of ``sd_px``: intervals follow Student's t with as many.
        unit_cov: (6, 6) covariance for clicks of 1 px, of the position (world, metres) and of a turn about the
            camera's axes (radians).
        lens_cov: (6, 6) covariance of the same that comes from the lens.
    """

    camera: RigCamera
    error_px: Array
    left_out: tuple[int, ...]
    sd_px: float
    freedom: int
    unit_cov: Array
    lens_cov: Array

    @property
    def cov(self) -> Array:
        """(6, 6) covariance of position and turn."""
        return self.sd_px**2 * self.unit_cov + self.lens_cov

    @property
    def position_sd_m(self) -> Array:
        """(3,) standard deviations of the position."""
        return np.sqrt(np.diag(self.cov)[:3])

    @property
    def turn_sd_rad(self) -> Array:
        """(3,) standard deviations of a turn about the camera's axes."""
        return np.sqrt(np.diag(self.cov)[3:])

    @property
    def t95(self) -> float:
        """Standard deviations on each side of a 95 % interval."""
        return float(stats.t.ppf(0.975, self.freedom))

    @property
    def rms_px(self) -> float:
        """Root mean square length of the errors of the points that were used."""
        return _rms(np.delete(self.error_px, list(self.left_out), axis=0))


def place_cameras(
    lenses: Sequence[KnownLens], xyz_m: Array, uv_px: Array, *, labels: Sequence[str] = ()
) -> tuple[PlacedCamera, ...]:
    """Place cameras one by one; the noise of clicking is pooled over cameras whose noises are alike (F test at 1 %).

    Args:
        lenses: The C lenses, which are held.
        xyz_m: (P, 3) known points.
        uv_px: (C, P, 2) recorded pixels, counted as the lenses count; NaN where not clicked.
        labels: (P) names of the points, for messages; empty: their numbers from 1.

    Raises:
        CalibrationError: too few points, pixels that do not belong to them, or points that leave a place open.
    """
    found = [place_camera(lens, xyz_m, uv, labels=labels) for lens, uv in zip(lenses, uv_px, strict=True)]
    out = []
    for place in found:
        alike = [p for p in found if _alike(p, place)]
        freedom = sum(p.freedom for p in alike)
        out.append(
            replace(
                place,
                sd_px=float(np.sqrt(sum(p.sd_px**2 * p.freedom for p in alike) / freedom)),
                freedom=freedom,
            )
        )
    return tuple(out)


def _alike(a: PlacedCamera, b: PlacedCamera) -> bool:
    if a is b or a.sd_px == b.sd_px:
        return True
    return 0.005 < float(stats.f.cdf((a.sd_px / max(b.sd_px, 1e-12)) ** 2, a.freedom, b.freedom)) < 0.995


def place_camera(known_lens: KnownLens, xyz_m: Array, uv_px: Array, *, labels: Sequence[str] = ()) -> PlacedCamera:
    """The position and orientation whose predicted pixels are nearest to the recorded ones (least squares).

    Starts are those of OpenCV's ``solvePnP`` (SQPnP, of Terzakis & Lourakis 2020; IPPE, of Collins & Bartoli 2014, for
    points in a plane, where there may be two). A point whose studentised residual no click would have by chance is left
    out and named, as long as 5 remain. The covariance is s^2 (J^T J)^-1, s^2 from the residuals with 2 n - 6 degrees of
    freedom, and G C G^T of the lens's covariance C, G = -(J^T J)^-1 J^T J_lens.

    Args:
        known_lens: The lens.
        xyz_m: (P, 3) known points in the world.
        uv_px: (P, 2) recorded pixels; NaN where not clicked.
        labels: (P) names of the points.

    Raises:
        CalibrationError: as ``place_cameras``.
    """
    labels = labels or [str(i + 1) for i in range(len(xyz_m))]
    name = known_lens.name
    seen = np.flatnonzero(np.isfinite(uv_px).all(axis=-1) & np.isfinite(xyz_m).all(axis=-1))
    _, once = np.unique(np.concatenate([xyz_m[seen], uv_px[seen]], axis=1), axis=0, return_index=True)
    seen = seen[np.sort(once)]  # a row that is listed twice is one click
    place = np.full(len(xyz_m), -1)
    place[seen] = distinct(xyz_m[seen])
    if place.max(initial=-1) + 1 < FEWEST_POINTS:
        raise CalibrationError(
            f"camera {name!r}: {place.max(initial=-1) + 1} different known points were clicked, and {FEWEST_POINTS} "
            "are needed (6 or more tell a wrong one): click more"
        )
    spread = np.linalg.svd(xyz_m[seen] - xyz_m[seen].mean(axis=0), compute_uv=False)
    if spread[1] < 1e-3 * spread[0]:
        raise CalibrationError(f"camera {name!r}: its known points lie on one line: add points beside it")
    used, left_out = seen, []
    fit = _best(known_lens, xyz_m[used], uv_px[used])
    while len(np.unique(place[used])) > 5 and (worst := _wrong(fit)) is not None:
        left_out.append(int(used[worst]))
        used = np.delete(used, worst)
        fit = _best(known_lens, xyz_m[used], uv_px[used])
    if len(left_out) > len(seen) / 4 or fit.rms_px > max(3.0, 0.005 * max(known_lens.size_px or (0,))):
        whole = _best(known_lens, xyz_m[seen], uv_px[seen])
        raise CalibrationError(
            _misfit(known_lens, xyz_m[seen], uv_px[seen], whole.rms_px, [str(labels[i]) for i in left_out])
        )
    if fit.other is not None:
        one, other = fit.camera.position_m, fit.other.position_m
        raise CalibrationError(
            f"camera {name!r}: its {len(used)} points fit two places alike, ({_metres(one)}) and ({_metres(other)}) m: "
            "click points outside of their plane, or nearer to the camera"
        )
    place = _place(known_lens, xyz_m, uv_px, fit, used, tuple(left_out))
    distance = float(np.linalg.norm(xyz_m[used].mean(axis=0) - fit.camera.position_m))
    loose = float(np.sqrt(np.trace(place.cov[:3, :3])))
    if loose > 0.1 * distance:
        raise CalibrationError(
            f"camera {name!r}: its points leave its position open by {loose:.2g} m at {distance:.2g} m: click points "
            "that span more of its image and of its depth"
        )
    return place


@dataclass(frozen=True, eq=False, kw_only=True)
class _Fit:
    """A place fitted to points: residuals (n, 2), slopes (2 n, 6) of the pixels, another place that fits alike."""

    camera: RigCamera
    error_px: Array
    slopes: Array
    other: RigCamera | None

    @property
    def rms_px(self) -> float:
        return _rms(self.error_px)


def _best(known_lens: KnownLens, xyz: Array, uv: Array) -> _Fit:
    """The least squares place, from all starts; the second best minimum too, where its errors are as likely."""
    minima: list[tuple[float, RigCamera, Array, Array]] = []
    for start in _starts(known_lens, xyz, uv):
        best = least_squares(lambda p, s=start: (_stepped(s, p).record(xyz) - uv).ravel(), np.zeros(6), x_scale="jac")
        camera = _stepped(start, best.x)
        if ((xyz @ camera.rotation.T + camera.translation_m)[:, 2] > 0).all():
            slopes = _slopes(camera, xyz)
            minima.append((float(2 * best.cost), camera, -best.fun.reshape(-1, 2), slopes))
    if not minima:
        raise CalibrationError(
            f"camera {known_lens.name!r} cannot be placed in front of its points: check that the pixels are in the "
            "order of the points"
        )
    minima.sort(key=lambda m: m[0])
    cost, camera, error, slopes = minima[0]
    noise = max(cost / max(2 * len(xyz) - 6, 1), 1e-6)
    alike = [c for v, c, _, _ in minima[1:] if v - cost < 9 * noise]
    apart = [c for c in alike if turned_rad(c.rotation.T @ camera.rotation) > 0.05]
    return _Fit(camera=camera, error_px=error, slopes=slopes, other=apart[0] if apart else None)


def _starts(known_lens: KnownLens, xyz: Array, uv: Array) -> list[RigCamera]:
    lens = known_lens.lens
    xy = np.ascontiguousarray(lens.normalised(lens.undistort(uv)))
    ok = np.isfinite(xy).all(axis=-1)
    if ok.sum() < FEWEST_POINTS:
        raise CalibrationError(
            f"camera {known_lens.name!r}: {np.count_nonzero(~ok)} of its pixels lie where its lens has no ray: are the "
            "lenses in the order of the pixels?"
        )
    centred = xyz[ok] - xyz[ok].mean(axis=0)
    spread, axes = np.linalg.svd(centred)[1:]
    plane = spread[2] < 1e-3 * spread[0]
    axes = axes * np.array([1.0, 1.0, np.linalg.det(axes)])[:, None]
    local = centred @ axes.T
    local[:, 2] *= not plane
    out = []
    for flag in (cv2.SOLVEPNP_SQPNP, *((cv2.SOLVEPNP_IPPE,) if plane else ())):
        found, rotations, shifts, _ = cv2.solvePnPGeneric(local, xy[ok], np.eye(3), None, flags=flag)
        for rvec, tvec in zip(rotations, shifts, strict=True) if found else ():
            rotation = np.asarray(cv2.Rodrigues(rvec)[0], dtype=float) @ axes
            shift = np.ravel(np.asarray(tvec, dtype=float)) - rotation @ xyz[ok].mean(axis=0)
            out.append(
                RigCamera(
                    name=known_lens.name,
                    lens=lens,
                    rotation=rotation,
                    translation_m=shift,
                    size_px=known_lens.size_px,
                )
            )
    return out


def _stepped(camera: RigCamera, step: Array) -> RigCamera:
    """The camera moved by (3,) in the world and turned by (3,) about its own axes."""
    rotation = turn(step[3:]) @ camera.rotation
    return replace(camera, rotation=rotation, translation_m=-rotation @ (camera.position_m + step[:3]))


def _slopes(camera: RigCamera, xyz: Array) -> Array:
    """(2 n, 6) derivatives of the pixels by the step (central differences)."""
    columns = []
    depth = float(np.mean(xyz @ camera.rotation[2]) + camera.translation_m[2])
    for i in range(6):
        h = np.zeros(6)
        h[i] = 1e-6 * (depth if i < 3 else 1.0)
        columns.append((_stepped(camera, h).record(xyz) - _stepped(camera, -h).record(xyz)).ravel() / (2 * h[i]))
    return np.stack(columns, axis=-1)


def _wrong(fit: _Fit) -> int | None:
    """The point whose errors the others make most unlikely (studentised residual of its two coordinates, F test)."""
    n = len(fit.error_px)
    freedom = 2 * n - 6
    total = float(np.sum(fit.error_px**2))
    if freedom < 4 or total == 0:
        return None
    hat = fit.slopes @ np.linalg.pinv(fit.slopes)
    levels = []
    for i in range(n):
        own = np.eye(2) - hat[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]
        explained = float(fit.error_px[i] @ np.linalg.solve(own + 1e-9 * np.eye(2), fit.error_px[i]))
        rest = max(total - explained, 1e-12 * total) / (freedom - 2)
        levels.append(float(stats.f.sf(explained / 2 / max(rest, 1e-4), 2, freedom - 2)))
    worst = int(np.argmin(levels))
    return worst if levels[worst] < 1e-3 / n else None  # so few clicks of a camera would miss as far by chance


def _place(
    lens: KnownLens, xyz: Array, uv: Array, fit: _Fit, used: NDArray[np.intp], left_out: tuple[int, ...]
) -> PlacedCamera:
    camera = fit.camera
    freedom = 2 * len(used) - 6
    unit = np.linalg.inv(fit.slopes.T @ fit.slopes)
    by_lens = []
    for i in range(len(lens.free)):
        h = np.zeros(len(lens.free))
        h[i] = 1e-3 * float(np.sqrt(lens.cov[i, i])) + 1e-9
        ahead, behind = (replace(camera, lens=lens.moved(s * h)).record(xyz[used]).ravel() for s in (1, -1))
        by_lens.append((ahead - behind) / (2 * h[i]))
    gain = -unit @ fit.slopes.T @ np.stack(by_lens, axis=-1) if by_lens else np.zeros((6, 0))
    return PlacedCamera(
        camera=camera,
        error_px=uv - camera.record(xyz),
        left_out=left_out,
        sd_px=max(float(np.sqrt(np.sum(fit.error_px**2) / freedom)), 1e-6),
        freedom=freedom,
        unit_cov=unit,
        lens_cov=gain @ lens.cov @ gain.T,
    )


def _misfit(lens: KnownLens, xyz: Array, uv: Array, rms_px: float, odd: Sequence[str]) -> str:
    """Why pixels do not belong to points, as far as it can be told."""
    start = f"camera {lens.name!r}: its known points have an RMS reprojection error of {rms_px:.1f} px"
    if lens.size_px is not None:
        flipped = np.array([0.0, lens.size_px[1] - 1.0]) + uv * [1.0, -1.0]
        try:
            other = _best(lens, xyz, flipped).rms_px
        except CalibrationError:
            other = np.inf
        if other < rms_px / 3:
            return (
                f"{start}, and by {other:.2f} px if rows are counted from below: give `origin` lower-left, or check "
                "that the points' axes are right-handed"
            )
    if odd:
        start += f"; {', '.join(odd)} agree least with the others"
    return f"{start}: check that both files list the same points, their unit, and that the lens is this camera's"


def _rms(error: Array) -> float:
    return float(np.sqrt(np.nanmean(np.sum(error**2, axis=-1))))


def _metres(place: Array) -> str:
    return ", ".join(f"{x:.3f}" for x in place)
