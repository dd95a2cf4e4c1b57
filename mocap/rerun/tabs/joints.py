"""Tab: each joint over its empirical potential."""

import rerun as rr
import rerun.blueprint as rrb

from mocap.pipeline.run import Run
from mocap.rerun import palette, paths
from mocap.rerun.chart import SIZE as CHART_SIZE
from mocap.rerun.landscape import RANGE
from mocap.rerun.layout import Layout
from mocap.rerun.log_joints import log_coordinates, log_potential
from mocap.rerun.log_volume import log_volume
from mocap.rerun.scene_views import last_frames, surface_view, volume_view
from mocap.rerun.series import series_view


def log(rec: rr.RecordingStream, run: Run, layout: Layout) -> None:
    """Coordinates, potentials in the planes of limbs, and potentials in the body."""
    t_s = run.tracked.markers.t_s
    for name, frame in layout.joint_frames.items():
        log_coordinates(rec, run.joints[frame], name)
    for name, land in layout.landscapes.items():
        log_potential(rec, name, t_s, land)
    for name, cloud in layout.blocks.items():
        log_volume(rec, name, t_s, cloud)


def tab(layout: Layout) -> rrb.Container | None:
    """A tab for every joint that has a potential, and one for the others."""
    if not layout.joint_frames:
        return None
    parts: list[rrb.Container | rrb.View] = [joint(layout, name) for name in layout.landscapes]
    others = [name for name in layout.joint_frames if name not in layout.landscapes]
    if others:
        parts.append(rrb.Grid(*(coordinates_view(layout, name) for name in others), name="Other joints"))
    return rrb.Tabs(*parts, active_tab=0, name="Joints and potentials")


def joint(layout: Layout, name: str) -> rrb.Container:
    """The potential of a joint, and the joint moving over it."""
    land, series = layout.landscapes[name], paths.joint_series(name)
    spatial = [volume_view(layout, name)] if name in layout.blocks else []
    return rrb.Vertical(
        rrb.Horizontal(surface_view(layout, name), heat_map_view(layout, name), *spatial),
        rrb.Horizontal(
            series_view(f"{series}/potential", f"{name}: V_z(q(t)) and its bound"),
            series_view(f"{series}/energy", f"{name}: energy (J/kg), 1/eps² = {land.energy.strength:.2g}"),
            coordinates_view(layout, name),
            spectrum_view(name),
        ),
        row_shares=[5, 2],
        name=name,
    )


def heat_map_view(layout: Layout, name: str) -> rrb.View:
    """The potential of a joint from above, with its range and its preferred configurations."""
    land = layout.landscapes[name]
    (x0, x1), (y0, y1) = land.x_mm[[0, -1]], land.y_mm[[0, -1]]
    return rrb.Spatial2DView(
        origin=paths.heat_map(name),
        name=f"{name}: range V < {RANGE:g} (white), preferred configurations (red)",
        background=palette.GROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=[x0, x1], y_range=[-y1, -y0]),
        overrides={f"{paths.heat_map(name)}/trail": last_frames(layout.trail_frames)},
    )


def spectrum_view(name: str) -> rrb.View:
    """Eigenvalues and lambda."""
    width, height = CHART_SIZE
    return rrb.Spatial2DView(
        origin=paths.spectrum(name),
        name=f"{name}: eigenvalues and lambda",
        background=palette.GROUND,
        visual_bounds=rrb.VisualBounds2D(
            x_range=[-0.17 * width, 1.05 * width], y_range=[-0.12 * height, 1.12 * height]
        ),
    )


def coordinates_view(layout: Layout, name: str) -> rrb.View:
    """The coordinates of a joint over time."""
    frame = layout.joint_frames[name]
    return series_view(f"{paths.joint_series(name)}/coordinates", f"{name}: coordinates in frame {frame} (mm)")
