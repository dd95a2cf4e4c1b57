"""Limbs on the potentials that held them while they were tracked, and what these pull at."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from eal.arrays import Array
from mocap.filters.limb_potential import HeldPotential
from mocap.rerun import palette, paths
from mocap.rerun.blueprint import log_line, series_view
from mocap.rerun.columns import log_over_time, single, ui
from mocap.rerun.layout import Layout
from mocap.rerun.log_markers import ELLIPSOID_SD
from mocap.rerun.over_plane import FLIP, log_moving, log_picture, plane_view
from mocap.rerun.scene_views import eye, world_view
from mocap.sides import words
from mocap.tracking.result import Result

REACH = 0.35
"""Length of the strongest pulls (99 %), over the radius of the scene."""


def log_limbs(rec: rr.RecordingStream, run: Result, layout: Layout) -> None:
    """Each limb's map with its state, and its pulls in the scene."""
    t_s = run.t_s
    for name, limb in layout.run.limbs.items():
        # the potential from above, and the state with its ellipse on it
        path = f"{paths.child(paths.LIMBS, name)}/map"
        log_picture(rec, f"{path}/potential", limb["x"], limb["y"], limb["value"])
        way = {"dots": palette.GROUND, "trail": palette.BLUE, "ball_radius": 3.5}
        log_moving(rec, path, t_s, limb["samples"] * FLIP, limb["state"] * FLIP, **way)
        look = rr.LineStrips2D.from_fields(colors=palette.WHITE, radii=ui(1.25), draw_order=28.0)
        finite = np.isfinite(limb["state"]).all(axis=1) & np.isfinite(limb["covariance"]).all(axis=(1, 2))
        lines = rr.LineStrips2D.columns(strips=list(single(ellipses(limb)[finite] * FLIP)))
        log_over_time(rec, f"{path}/ellipse", t_s, lines, look, counts=finite)
        log_line(
            rec,
            f"{paths.child(paths.LIMBS, name)}/series/value",
            t_s,
            limb["at_state"],
            name="V_z",
            color=palette.ORANGE,
        )
        at = run.xyz_m[:, limb["marker"]]
        _log_pull(rec, name, t_s, layout.scene.points(at), layout.scene.points(limb["pull"]), layout.scene.radius_m)


def limb_tab(layout: Layout, name: str) -> rrb.Container:
    """A limb's map, its V_z over time, and its pulls on the body."""
    return rrb.Horizontal(
        rrb.Vertical(
            map_view(layout, name),
            series_view(f"{paths.child(paths.LIMBS, name)}/series", f"{name}: V_z where the limb was"),
            row_shares=[3, 1],
        ),
        pull_view(layout, name),
        name=f"Held in the filter: {words(name)}",
    )


def limbs_of(layout: Layout, joint: str) -> list[str]:
    """The limbs that were held and move at a joint: its centre and child are markers of theirs."""
    run = layout.run
    ends = next(({j.centre, j.child} for j in run.skeleton.joints if j.name == joint), set())
    return [name for name, limb in run.limbs.items() if ends and ends <= {run.names[m] for m in limb["marker"]}]


def map_view(layout: Layout, name: str) -> rrb.View:
    """The potential in its two leading coordinates, from above."""
    title = f"{words(name)}: V_z that held it in the filter (fixed kernel), state and {ELLIPSOID_SD:g} sd"
    limb = layout.run.limbs[name]
    return plane_view(f"{paths.child(paths.LIMBS, name)}/map", title, limb["x"], limb["y"], layout.trail_frames)


def pull_view(layout: Layout, name: str) -> rrb.View:
    """The body, and the potential's pull on each joint of the limb."""
    scene = layout.scene
    return world_view(
        paths.WORLD,
        f"{name}: pull of V_z on each joint (arrows)",
        contents=[paths.SKELETON, f"{paths.MARKERS}/**", paths.child(paths.PULL, name)],
        ground=(scene.up, scene.ground_m, scene.radius_m),
        look=eye(scene.centre_m, 1.85 * scene.radius_m, scene.up),
        trail=(paths.TRAILS, layout.scene_trail_frames),
    )


def ellipses(limb: HeldPotential) -> Array:
    """(T, P, 2) outlines of ``ELLIPSOID_SD`` standard deviations round the state; NaN where it is not known."""
    angle = np.linspace(0.0, 2.0 * np.pi, 33)
    circle = ELLIPSOID_SD * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    finite = np.asarray(np.isfinite(limb["covariance"]).all(axis=(1, 2)))
    value, vectors = np.linalg.eigh(np.where(finite[:, None, None], limb["covariance"], np.eye(2)))
    root = vectors * np.sqrt(np.maximum(value, 0.0))[:, None]
    return np.where(finite[:, None, None], limb["state"][:, None] + circle @ np.swapaxes(root, 1, 2), np.nan)


def _log_pull(rec: rr.RecordingStream, name: str, t_s: Array, at: Array, pull: Array, radius_m: float) -> None:
    path = paths.child(paths.PULL, name)
    length = np.linalg.norm(pull, axis=-1)
    finite = np.isfinite(at).all(axis=-1) & np.isfinite(length)
    strongest = float(np.quantile(length[finite], 0.99)) if finite.any() else 0.0
    scale = REACH * radius_m / strongest if strongest > 0 else 0.0
    look = rr.Arrows3D.from_fields(colors=palette.VERMILLION, radii=ui(2.0))
    columns = rr.Arrows3D.columns(origins=single(at[finite]), vectors=single(scale * pull[finite]))
    log_over_time(rec, path, t_s, columns, look, counts=finite.sum(axis=1))
