"""Tab: each joint over its empirical potential."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from eal.arrays import Array
from mocap.rerun import palette, paths
from mocap.rerun.blueprint import log_line, rows, series_view
from mocap.rerun.columns import Single, log_over_time, single, ui
from mocap.rerun.landscape import MM_PER_M, Block, JointEnergy, Landscape
from mocap.rerun.layout import Layout
from mocap.rerun.limbs import limb_tab, limbs_of, log_limbs
from mocap.rerun.over_plane import FLIP, log_map, log_moving, log_surface, plane_view
from mocap.rerun.scene_views import eye, last_frames, scene_view
from mocap.sides import by_side, words
from mocap.tracking.joint_map import EDGE
from mocap.tracking.result import Result

COORDINATES = ("q1", "q2", "q3")
_DECADES = 8
"""Decades of eigenvalues that are drawn."""
OUTSIDE = "outside its usual range"
"""Said at the ball where it is on no low place of the potential."""
ONE_ROW = 12
"""So many names of joints stand in one row of tabs of a small screen; more are grouped by side."""
CHART_SIZE = (160.0, 100.0)
"""Width and height of the chart of eigenvalues, in units of its view."""


def log(rec: rr.RecordingStream, run: Result, layout: Layout) -> None:
    """Coordinates, potentials in the planes of limbs, and potentials in the body."""
    t_s = run.t_s
    for name, frame in layout.joint_frames.items():
        # the coordinates of one joint of the tracks, in millimetres
        lines = run.joints_m(frame)[name] * MM_PER_M
        n_lines = lines.shape[1]
        path = f"{paths.joint(name, 'series')}/coordinates"
        log_line(rec, path, t_s, lines, name=COORDINATES[:n_lines], color=palette.SERIES[:n_lines])
    for name, land in layout.landscapes.items():
        _log_surface(rec, paths.joint(name, "surface"), t_s, land)
        _log_heat_map(rec, paths.joint(name, "map"), t_s, land)
        _log_energy(rec, paths.joint(name, "series"), t_s, land.path_value, land.energy)
        _log_spectrum(rec, paths.joint(name, "spectrum"), land)
    for name, cloud in layout.blocks.items():
        _log_volume(rec, name, t_s, cloud)
    log_limbs(rec, run, layout)


def tab(layout: Layout) -> rrb.Container | None:
    """A tab for every joint that has a potential, one for the others, and one for each limb."""
    if not layout.joint_frames and not layout.run.limbs:
        return None
    sides = by_side(layout.landscapes)
    each = {name: joint(layout, name) for name in layout.landscapes}
    parts: list[rrb.Container | rrb.View] = list(each.values())
    if len(sides) > 1 and len(parts) > ONE_ROW:
        parts = [
            rrb.Tabs(*(each[name] for name in names), active_tab=0, name=side.capitalize())
            for side, names in sides.items()
        ]
    others = [name for name in layout.joint_frames if name not in layout.landscapes]
    if others:
        parts.append(rows([coordinates_view(layout, name) for name in others], name="Other joints"))
    shown = {limb for name in layout.landscapes for limb in limbs_of(layout, name)}
    parts += [limb_tab(layout, name) for name in layout.run.limbs if name not in shown]
    return rrb.Tabs(*parts, active_tab=0, name="Joints and potentials")


def joint(layout: Layout, name: str) -> rrb.Container:
    """The map of a joint's potential beside the animal; for experts surface, coordinates, energies and eigenvalues."""
    series = paths.joint(name, "series")
    person = rrb.Horizontal(
        heat_map_view(layout, name),
        rrb.Vertical(
            scene_view(layout),
            series_view(f"{series}/potential", "0: where it often is, 1: where it never is", y_range=(0.0, 1.0)),
            row_shares=[3, 1],
        ),
        column_shares=[5, 4],
        name="Map",
    )
    spatial = [volume_view(layout, name)] if name in layout.blocks else []
    strength = layout.landscapes[name].energy.strength
    expert = rrb.Vertical(
        rrb.Horizontal(surface_view(layout, name), *spatial, spectrum_view(name)),
        rrb.Horizontal(
            coordinates_view(layout, name),
            series_view(f"{series}/release", "V_z and its bound after a release (Theorem 3)"),
            series_view(f"{series}/energy", f"energy (J/kg), 1/eps² = {strength:.2g}"),
        ),
        row_shares=[3, 2],
        name="Expert",
    )
    # the V_z of the map is chosen and shown; those that held the limb while it was tracked are fixed, and another kind
    held = [limb_tab(layout, limb) for limb in limbs_of(layout, name)]
    return rrb.Tabs(person, *held, expert, active_tab=0, name=words(name))


def heat_map_view(layout: Layout, name: str) -> rrb.View:
    """The map of the potential of a joint, and where the joint is."""
    found, path = layout.landscapes[name].map, paths.joint(name, "map")
    title = f"{found.name}: yellow where it was held, violet where it never was; red: now; bars: how often"
    return plane_view(path, title, found.x_mm, found.y_mm, layout.trail_frames)


def spectrum_view(name: str) -> rrb.View:
    """Eigenvalues and lambda."""
    width, height = CHART_SIZE
    return rrb.Spatial2DView(
        origin=paths.joint(name, "spectrum"),
        name="eigenvalues and lambda",
        background=palette.GROUND,
        visual_bounds=rrb.VisualBounds2D(
            x_range=[-0.17 * width, 1.05 * width], y_range=[-0.12 * height, 1.12 * height]
        ),
    )


def coordinates_view(layout: Layout, name: str) -> rrb.View:
    """The coordinates of a joint over time."""
    frame = layout.joint_frames[name]
    return series_view(f"{paths.joint(name, 'series')}/coordinates", f"coordinates in frame {frame} (mm)")


def surface_view(layout: Layout, name: str) -> rrb.View:
    """The potential of a joint as a surface, seen from high enough to look into its wells."""
    land, up = layout.landscapes[name], np.array([0.0, 0.0, 1.0])
    middle = np.array([land.x_mm.mean(), land.y_mm.mean(), 0.4 * land.height_mm])
    look = eye(middle, 2.0 * float(land.x_mm[-1] - land.x_mm[0]), up, rise=1.1)
    title = "joint potential: 0 (yellow) where the joint goes, 1 (violet) elsewhere; pink: preferred; mm"
    return _solid_view(layout, paths.joint(name, "surface"), title, look)


def volume_view(layout: Layout, name: str) -> rrb.View:
    """The potential of a joint as a cloud, and the limb in it."""
    cloud = layout.blocks[name]
    look = eye(cloud.centre_mm, 1.9 * cloud.extent_mm, np.array([0.0, 0.0, 1.0]))
    return _solid_view(layout, paths.joint(name, "volume"), "in body axes (mm): dense where the joint often is", look)


def _solid_view(layout: Layout, path: str, title: str, look: rrb.EyeControls3D) -> rrb.View:
    return rrb.Spatial3DView(
        origin=path,
        name=title,
        background=palette.GROUND,
        line_grid=False,
        eye_controls=look,
        overrides={f"{path}/trail": last_frames(layout.trail_frames)},
    )


def _log_energy(rec: rr.RecordingStream, path: str, t_s: Array, value: Array, energy: JointEnergy) -> None:
    """V_z on the way, alone and with the bound of Theorem 3, and the energy that this bound rests on."""
    log_line(rec, f"{path}/potential/value", t_s, value, name="joint potential", color=palette.ORANGE)
    both = np.column_stack([value, energy.bound])
    log_line(rec, f"{path}/release", t_s, both, name=("V_z", "bound"), color=(palette.ORANGE, palette.GREY))
    parts = np.column_stack([energy.kinetic + energy.potential, energy.kinetic, energy.potential])
    colors = (palette.WHITE, palette.SKY_BLUE, palette.ORANGE)
    log_line(rec, f"{path}/energy", t_s, parts, name=("total", "kinetic", "V_z / eps²"), color=colors)


def _log_spectrum(rec: rr.RecordingStream, path: str, land: Landscape) -> None:
    """Eigenvalues of T_z over their number on a logarithmic scale, and lambda across."""

    def height(value: Array) -> Array:
        return 1 + np.log10(np.maximum(value, 10.0**-_DECADES)) / _DECADES

    n = len(land.eigenvalues)
    shown = land.eigenvalues > 10.0**-_DECADES
    number = np.arange(1, n + 1)[shown]
    most = max(int(number[-1]) if len(number) else 1, 2)
    dots = np.column_stack([(number - 1) / (most - 1), height(land.eigenvalues[shown])])
    level = float(height(np.array(land.lam)))
    box = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)], dtype=np.float64)
    across = np.array([(0.0, level), (1.0, level)])
    lines = rr.LineStrips2D([_in_chart(box), _in_chart(across)], colors=[palette.DIM, palette.ORANGE], radii=ui(1.0))
    rec.log(f"{path}/lines", lines, static=True)
    points = rr.Points2D(_in_chart(dots), colors=palette.SKY_BLUE, radii=ui(2.5), draw_order=40.0)
    rec.log(f"{path}/dots", points, static=True)
    ticks = [
        *((-0.07, 1 - d / _DECADES, f"1e-{d}" if d else "1") for d in range(0, _DECADES, 2)),
        (0.0, 0.0, "1"),
        (1.0, 0.0, f"{most}"),
        (0.75, level + 0.14, f"lambda {land.lam:.0e}, rank {land.effective_rank:.0f}"),
    ]
    places, texts = _in_chart(np.array([(x, y) for x, y, _ in ticks])), [text for *_, text in ticks]
    names = rr.Points2D(places, labels=texts, colors=palette.GREY, radii=0.0, show_labels=True)
    rec.log(f"{path}/ticks", names, static=True)


def _in_chart(xy: Array) -> Single:
    """(n, 2) of the chart, up, each in [0, 1], to (n, 2) of the view, down."""
    return single(np.column_stack([xy[:, 0], 1 - xy[:, 1]]) * CHART_SIZE)


def _log_surface(rec: rr.RecordingStream, path: str, t_s: Array, land: Landscape) -> None:
    rec.log(path, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    log_surface(rec, f"{path}/potential", land.x_mm, land.y_mm, land.value, land.height_mm)
    _log_frame(rec, f"{path}/frame", land)
    way = land.lifted(land.path_mm)
    # the half of least V: preferred configurations, as in Figs 7 and 8 of the paper
    preferred = land.samples_value <= np.median(land.samples_value)
    dots = np.where(preferred[:, None], palette.PURPLE, palette.GROUND).astype(np.uint8)
    log_moving(rec, path, t_s, land.lifted(land.samples_mm), way, dots=dots, trail=palette.BLUE)
    lifted = [land.lifted(line) for line in land.contour_mm(EDGE)]
    rec.log(f"{path}/range", rr.LineStrips3D(lifted, colors=palette.WHITE, radii=ui(1.0)), static=True)


def _log_frame(rec: rr.RecordingStream, path: str, land: Landscape) -> None:
    """The rectangle under the surface, with its ends in millimetres."""
    (x0, x1), (y0, y1) = land.x_mm[[0, -1]], land.y_mm[[0, -1]]
    corners = np.array([(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0), (x0, y0, 0), (x0, y0, land.height_mm)])
    rec.log(f"{path}/box", rr.LineStrips3D([corners], colors=palette.GREY, radii=ui(1.0)), static=True)
    middle_x, middle_y = (x0 + x1) / 2, (y0 + y1) / 2
    ticks = [
        ((x0, y0, 0), f"{x0:.0f}, {y0:.0f}"),
        ((middle_x, y0, 0), "q1 / mm"),
        ((x1, y0, 0), f"{x1:.0f}"),
        ((x1, middle_y, 0), "q2 / mm"),
        ((x1, y1, 0), f"{y1:.0f}"),
        ((x0, y0, land.height_mm), "V = 1"),
    ]
    places, texts = zip(*ticks, strict=True)
    names = rr.Points3D(list(places), labels=list(texts), colors=palette.GREY, radii=ui(1.5), show_labels=True)
    rec.log(f"{path}/ticks", names, static=True)


def _log_heat_map(rec: rr.RecordingStream, path: str, t_s: Array, land: Landscape) -> None:
    log_map(rec, f"{path}/potential", land.map)
    way = land.path_mm * FLIP
    log_moving(rec, path, t_s, None, way, trail=palette.VERMILLION, limb_radius=2.5, limb_color=palette.VERMILLION)
    outside = land.path_value > EDGE
    label = rr.Points2D.from_fields(colors=palette.VERMILLION, radii=ui(1.0), show_labels=True, draw_order=45.0)
    columns = rr.Points2D.columns(positions=single(way[outside]), labels=[OUTSIDE] * int(outside.sum()))
    log_over_time(rec, f"{path}/outside", t_s, columns, label, counts=outside)


def _log_volume(rec: rr.RecordingStream, name: str, t_s: Array, cloud: Block) -> None:
    """1 - V_z as a volume, the samples in it, and the limb from the joint's centre to where it is."""
    path = paths.joint(name, "volume")
    volume = rr.Volume3D(
        (1 - cloud.value).astype(np.float16),
        voxel_size=(cloud.cell_mm,) * 3,
        translation=cloud.corner_mm,
        value_range=(0.0, 1.0),
        gamma=2.0,
        optical_density=5.0,
        colormap=rr.components.Colormap.Viridis,
    )
    rec.log(path, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    rec.log(f"{path}/potential", volume, static=True)
    log_moving(
        rec, path, t_s, cloud.samples_mm, cloud.path_mm, dots=palette.WHITE, trail=palette.ORANGE, limb_radius=2.0
    )
