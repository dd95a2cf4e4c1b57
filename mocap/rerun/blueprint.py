"""What is where on the screen: tabs of views, built from what the run has."""

import rerun.blueprint as rrb

from mocap.arrays import Array
from mocap.rerun import palette, paths
from mocap.rerun.chart import SIZE as CHART_SIZE
from mocap.rerun.columns import FRAME
from mocap.rerun.landscape import RANGE
from mocap.rerun.layout import Layout
from mocap.rerun.log_cameras import WHISKER_SCALE
from mocap.rerun.log_health import usual_limit
from mocap.rerun.row_map import WIDE, row_map_view
from mocap.rerun.scene_views import last_frames, rig_view, scene_view, surface_view, volume_view

_OVERVIEW_TILES = 4
_LINES = 4
_WIDE_TILES = 9


def make_blueprint(layout: Layout) -> rrb.Blueprint:
    """Tabs Overview, Cameras, Joints and potentials, Filter health, Report; those without content are left out."""
    tabs = [overview(layout)]
    if layout.bounds_px:
        tabs.append(cameras(layout))
    if layout.joint_frames:
        tabs.append(joints(layout))
    tabs += [health(layout), report_view()]
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0, name=layout.name),
        rrb.TimePanel(
            state=rrb.PanelState.Collapsed,
            timeline=FRAME,
            fps=layout.fps,
            play_state=rrb.components.PlayState.Paused,
        ),
        rrb.SelectionPanel(state=rrb.PanelState.Hidden),
        rrb.BlueprintPanel(state=rrb.PanelState.Hidden),
        auto_views=False,
        auto_layout=False,
    )


def overview(layout: Layout) -> rrb.Container:
    """The scene, the cameras that saw most, and who was seen when."""
    right: list[rrb.Container | rrb.View] = []
    if layout.bounds_px:
        names = list(layout.bounds_px)[:_OVERVIEW_TILES]
        tiles = (camera_view(layout, name) for name in sorted(names, key=_camera_order(layout).index))
        right.append(rrb.Grid(*tiles, grid_columns=min(2, len(names))))
    right.append(gap_map_view())
    return rrb.Horizontal(scene_view(layout), rrb.Vertical(*right), column_shares=[3, 2], name="Overview")


def cameras(layout: Layout) -> rrb.Container:
    """Where the cameras stand, and what each of them saw."""
    tiles = rrb.Grid(*(camera_view(layout, name) for name in _camera_order(layout)))
    return rrb.Horizontal(rig_view(layout), tiles, column_shares=[2, 3], name="Cameras")


def camera_view(layout: Layout, name: str) -> rrb.View:
    """One camera: its pixels, and the body as the viewer itself projects it; framed on what it saw."""
    (left, top), (right, bottom) = layout.bounds_px[name]
    return rrb.Spatial2DView(
        origin=paths.image(name),
        name=f"{name} (px, residuals {WHISKER_SCALE:g}x)" if len(layout.bounds_px) <= _WIDE_TILES else f"{name} (px)",
        contents=["$origin/**", paths.SKELETON, f"{paths.MARKERS}/filled"],
        background=palette.GROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=[left, right], y_range=[top, bottom]),
    )


def gap_map_view() -> rrb.View:
    """Who was seen when, at a glance."""
    return row_map_view(paths.GAP_MAP, "Gaps over frames: measured blue, filled yellow, rejected red")


def gap_lanes_view() -> rrb.View:
    """When each marker was seen, a lane each."""
    return rrb.StateTimelineView(
        origin=paths.GAPS,
        name="Gaps of each marker (frames)",
        time_view=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
    )


def joints(layout: Layout) -> rrb.Container:
    """A tab for every joint that has a potential, and one for the others."""
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
        name=f"{name}: range V < {RANGE:g} (white), preferred half (red)",
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


def health(layout: Layout) -> rrb.Container:
    """Is the filter consistent, frame by frame?"""
    limit = (0.0, layout.nis_limit)
    views = [series_view(paths.NIS, "Normalised innovation squared per row, 95 % band (expected 1)", y_range=limit)]
    errors = layout.errors
    if errors is not None:
        innovation, residual = (
            "Innovation before the update, rms",
            "Residual after smoothing, rms",
        )
        if len(errors.cameras) <= _LINES:
            views += [
                series_view(paths.INNOVATION, f"{innovation} of each camera (px)"),
                series_view(paths.RESIDUAL, f"{residual} of each camera (px)"),
            ]
        else:
            views += [
                row_map_view(
                    paths.INNOVATION_MAP, f"{innovation} of each camera: {_scale(errors.innovation_px)}", WIDE
                ),
                row_map_view(paths.RESIDUAL_MAP, f"{residual} of each camera: {_scale(errors.residual_px)}", WIDE),
            ]
    views += [
        series_view(paths.LOG_LIKELIHOOD, "Log-likelihood of each frame (nat)", legend=False),
        series_view(paths.ROWS, "Observations used in each frame (rows)", legend=False),
        gap_lanes_view(),
    ]
    return rrb.Grid(*views, grid_columns=2, name="Filter health")


def series_view(origin: str, name: str, *, y_range: tuple[float, float] | None = None, legend: bool = True) -> rrb.View:
    """Lines over frames; all such views share their time axis."""
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
        axis_y=rrb.ScalarAxis(range=y_range) if y_range else None,
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightTop, visible=legend),
        background=rrb.archetypes.PlotBackground(color=palette.GROUND, show_grid=True),
    )


def report_view() -> rrb.View:
    """The report."""
    return rrb.TextDocumentView(origin=paths.REPORT, name="Report")


def _scale(values_px: Array) -> str:
    return f"dark 0 to yellow {usual_limit(values_px):.3g} px"


def _camera_order(layout: Layout) -> list[str]:
    """Cameras with pixels in the order of the recording."""
    return [c.name for c in layout.scene.cameras if c.name in layout.bounds_px]
