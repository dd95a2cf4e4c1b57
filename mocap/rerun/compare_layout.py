"""What is where on the screen when runs are compared."""

from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb

from mocap.rerun import palette, paths
from mocap.rerun.columns import FRAME
from mocap.rerun.layout import trail_length
from mocap.rerun.row_map import row_map_view
from mocap.rerun.scene_views import eye, last_frames, world_view
from mocap.rerun.series import series_view
from mocap.rerun.stored import Stored

_TILES = 2


def compare_blueprint(runs: Sequence[Stored], limits: Sequence[float]) -> rrb.Blueprint:
    """Tabs: Together, Side by side, Cameras, Joints, Filter health, Reports; a column a run.

    Args:
        runs: What is compared.
        limits: Distance in mm at the end of the colours, for each run but the first.
    """
    tabs = [_together(runs, limits), _side_by_side(runs), *_cameras(runs), *_joints(runs), _health(runs)]
    reports = [
        rrb.TextDocumentView(origin=f"{paths.run(i)}{paths.REPORT}", name=run.name) for i, run in enumerate(runs)
    ]
    return rrb.Blueprint(
        rrb.Tabs(*tabs, rrb.Horizontal(*reports, name="Reports"), active_tab=0),
        rrb.TimePanel(
            state=rrb.PanelState.Collapsed,
            timeline=FRAME,
            fps=float(np.clip(len(runs[0].t_s) / 15, 10, 60)),
            play_state=rrb.components.PlayState.Paused,
        ),
        rrb.SelectionPanel(state=rrb.PanelState.Hidden),
        rrb.BlueprintPanel(state=rrb.PanelState.Hidden),
        auto_views=False,
        auto_layout=False,
    )


def _together(runs: Sequence[Stored], limits: Sequence[float]) -> rrb.Container:
    """All bodies in one scene, and how far they are from the first."""
    colors = ("blue", "orange", "green", "purple")
    title = ", ".join(f"{run.name} {color}" for run, color in zip(runs, colors, strict=False))
    scene = _scene(runs, paths.TOGETHER, f"Scene (m): {title}", [f"{paths.TOGETHER}/**"], (paths.TOGETHER, 0))
    maps = [
        row_map_view(paths.difference(i), f"{runs[i].name} from {runs[0].name}: dark 0 to yellow {limit:.3g} mm")
        for i, limit in enumerate(limits, start=1)
    ]
    lines = series_view(paths.APART, f"Distance from {runs[0].name}, rms of all markers (mm)")
    return rrb.Horizontal(scene, rrb.Vertical(*maps, lines), column_shares=[3, 2], name="Together")


def _side_by_side(runs: Sequence[Stored]) -> rrb.Container:
    """A scene a run, and who was seen when."""
    frames = trail_length(len(runs[0].t_s))
    columns = []
    for i, run in enumerate(runs):
        root = paths.run(i)
        shown = [paths.SKELETON, paths.PATH, paths.TRAILS, f"{paths.MARKERS}/**", f"{paths.UNCERTAINTY}/**"]
        contents = [f"{root}{path}" for path in shown]
        scene = _scene(runs, f"{root}{paths.WORLD}", f"{run.name} (m)", contents, (f"{root}{paths.TRAILS}", frames))
        gaps = row_map_view(f"{root}{paths.GAP_MAP}", f"{run.name}: measured blue, filled yellow, rejected red")
        columns.append(rrb.Vertical(scene, gaps, row_shares=[3, 2]))
    return rrb.Horizontal(*columns, name="Side by side")


def _cameras(runs: Sequence[Stored]) -> list[rrb.Container]:
    """The first cameras that all runs have, a row a camera."""
    common = [c for c in runs[0].below(paths.CAMERAS) if all(c in run.below(paths.CAMERAS) for run in runs)][:_TILES]
    rows = []
    for camera in common:
        tiles = []
        for i, run in enumerate(runs):
            image, root = f"{paths.run(i)}{paths.CAMERAS}/{camera}/image", paths.run(i)
            contents = ["$origin/**", f"{root}{paths.SKELETON}", f"{root}{paths.MARKERS}/filled"]
            tile = rrb.Spatial2DView(
                origin=image,
                name=f"{run.name}, {camera} (px)",
                contents=contents,
                background=palette.GROUND,
                visual_bounds=_tile_bounds(run, f"{paths.CAMERAS}/{camera}/image/reprojected"),
            )
            tiles.append(tile)
        rows.append(rrb.Horizontal(*tiles))
    return [rrb.Vertical(*rows, name="Cameras")] if rows else []


def _joints(runs: Sequence[Stored]) -> list[rrb.Container]:
    """Potentials of the joints that all runs have, from above, and V_z on the way."""
    common = [j for j in runs[0].below(paths.JOINTS) if all(j in run.below(paths.JOINTS) for run in runs)]
    tabs = []
    for joint in common:
        columns = []
        for i, run in enumerate(runs):
            root = f"{paths.run(i)}{paths.JOINTS}/{joint}"
            trail = last_frames(trail_length(len(run.t_s)))
            heat_map = rrb.Spatial2DView(
                origin=f"{root}/map",
                name=f"{run.name}, {joint}: V_z (mm)",
                background=palette.GROUND,
                visual_bounds=_map_bounds(run, f"{paths.JOINTS}/{joint}/map/potential"),
                overrides={f"{root}/map/trail": trail},
            )
            value = series_view(f"{root}/series/potential", f"{run.name}, {joint}: V_z(q(t)) and its bound")
            columns.append(rrb.Vertical(heat_map, value, row_shares=[5, 2]))
        tabs.append(rrb.Horizontal(*columns, name=joint))
    return [rrb.Tabs(*tabs, active_tab=0, name="Joints")] if tabs else []


def _tile_bounds(run: Stored, path: str) -> rrb.VisualBounds2D | None:
    """The part of an image that holds nearly all of the motion; None where there is none."""
    uv_px = run.points2d(path)
    if not len(uv_px):
        return None
    low, high = np.quantile(uv_px, (0.005, 0.995), axis=0)
    margin = 0.15 * max(high - low)
    return rrb.VisualBounds2D(x_range=[low[0] - margin, high[0] + margin], y_range=[low[1] - margin, high[1] + margin])


def _map_bounds(run: Stored, path: str) -> rrb.VisualBounds2D:
    """The part of a view that holds a map, from where its picture was put."""
    corner, cell = (run.static(path, f"Transform3D:{part}")[0] for part in ("translation", "scale"))
    shape = run.static(path, "Image:format")[0]
    ends = [(corner[k], corner[k] + cell[k] * shape[side]) for k, side in enumerate(("width", "height"))]
    return rrb.VisualBounds2D(x_range=ends[0], y_range=ends[1])


def _health(runs: Sequence[Stored]) -> rrb.Container:
    """Innovations and likelihood, a column a run."""
    series = (
        (paths.NIS, "squared prediction error over its expected value (NIS), 95 % band"),
        (paths.LOG_LIKELIHOOD, "log-likelihood (nat)"),
    )
    columns = [
        rrb.Vertical(*(series_view(f"{paths.run(i)}{path}", f"{run.name}: {what}") for path, what in series))
        for i, run in enumerate(runs)
    ]
    return rrb.Horizontal(*columns, name="Filter health")


def _scene(
    runs: Sequence[Stored],
    origin: str,
    name: str,
    contents: Sequence[str],
    trail: tuple[str, int],
) -> rrb.View:
    """A scene that frames the motion of all runs."""
    points = np.concatenate([run.xyz_m.reshape(-1, 3) for run in runs])
    points = points[np.isfinite(points).all(axis=1)]
    low, high = np.quantile(points, (0.005, 0.995), axis=0) if len(points) else np.zeros((2, 3))
    radius_m, up = max(float(np.linalg.norm(high - low)) / 2, 1e-3), runs[0].up
    height_m = float(min(low @ up, high @ up)) - 0.3 * radius_m
    return world_view(
        origin,
        name,
        contents=contents,
        ground=(up, height_m, radius_m),
        look=eye((low + high) / 2, 1.75 * radius_m, up),
        trail=trail,
    )
