"""A designed joint in rerun: V_z beside U as surfaces, and the truss deforming over the recorded way."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from eal.arrays import Array
from eal.joint_design import member_forces
from mocap.joint_design.design import JointDesign
from mocap.rerun import palette
from mocap.rerun.blueprint import log_line, screen
from mocap.rerun.columns import log_over_time, recording_into, segments, single, ui
from mocap.rerun.landscape import MM_PER_M
from mocap.rerun.over_plane import log_surface

APPLICATION = "mocap"
V, U, TRUSS, ENERGY = "/potential", "/energy", "/truss", "/along"
_MOVING = rr.Points3D.from_fields(colors=palette.VERMILLION, radii=ui(7.0))


def write_truss_recording(design: JointDesign, path: Path) -> None:
    """Write a designed joint as a recording; lengths in mm at the animal's size.

    Raises:
        RecordingError: rerun does not take it.
        OSError: the file cannot be written.
    """
    planar = design.truss.dimension == 2
    name, blueprint = f"joint-{design.source.name}", _blueprint(design, planar)
    with recording_into(path, application=APPLICATION, recording_id=name, blueprint=blueprint) as rec:
        if planar:
            _log_surface(rec, V, design, design.target.v, design.source.potential.value(design.way.states.q_m))
            along = design.way.states.energy_j - design.design.stored
            _log_surface(rec, U, design, np.clip(design.fit.u, 0.0, 1.0), np.clip(along, 0.0, 1.0))
        # the members at every frame, vermillion where they pull, blue where they push, dim without force
        truss, states, unit = design.design.truss, design.way.states, _millimetres(design)
        n, m = states.stretch.shape
        fixed = np.broadcast_to(truss.fixed_m, (n, *truss.fixed_m.shape))
        nodes = np.concatenate([fixed, states.q_m[:, None], states.x_m], axis=1) * unit
        nodes = np.concatenate([nodes, np.zeros((*nodes.shape[:2], 3 - truss.dimension))], axis=2)
        samples = design.source.potential.samples * unit
        samples = np.column_stack([samples, np.zeros((len(samples), 3 - truss.dimension))])
        rec.log(TRUSS, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        rec.log(f"{TRUSS}/samples", rr.Points3D(single(samples), colors=palette.GREY, radii=ui(1.5)), static=True)
        posts = rr.Points3D(single(nodes[0, : truss.moving]), colors=palette.WHITE, radii=ui(5.0))
        rec.log(f"{TRUSS}/posts", posts, static=True)
        rec.log(f"{TRUSS}/joint", rr.Points3D([[0, 0, 0]], colors=palette.YELLOW, radii=ui(5.0)), static=True)
        t_s, moving = design.source.t_s, nodes[:, truss.moving :]
        columns = rr.Points3D.columns(positions=single(moving.reshape(-1, 3)))
        log_over_time(rec, f"{TRUSS}/moving", t_s, columns, _MOVING, counts=np.full(n, moving.shape[1]))
        strips = segments(nodes[:, truss.ends[:, 0]].reshape(-1, 3), nodes[:, truss.ends[:, 1]].reshape(-1, 3))
        # (T, m, 3) colours of the members
        truss, stretch = design.design.truss, design.way.states.stretch
        pull = member_forces(truss, stretch)
        share = (np.abs(pull) / max(float(np.abs(pull).max()), 1e-12))[..., None] ** 0.5
        strong = np.where(pull[..., None] > 0.0, palette.VERMILLION, palette.SKY_BLUE)
        colours = np.round(share * strong + (1.0 - share) * np.array(palette.DIM)).astype(np.uint8).reshape(-1, 3)
        columns = rr.LineStrips3D.columns(strips=strips, colors=colours)
        log_over_time(
            rec, f"{TRUSS}/members", t_s, columns, rr.LineStrips3D.from_fields(radii=ui(2.5)), counts=np.full(n, m)
        )
        v = design.source.potential.value(design.way.states.q_m)
        u = design.way.states.energy_j - design.design.stored
        both = np.column_stack([v, u])
        log_line(rec, ENERGY, design.source.t_s, both, name=("V_z", "U"), color=(palette.SKY_BLUE, palette.ORANGE))


def _millimetres(design: JointDesign) -> float:
    return design.source.unit_m * MM_PER_M


def _log_surface(rec: rr.RecordingStream, path: str, design: JointDesign, value: Array, along: Array) -> None:
    """A value in 0..1 over the grid, samples at its foot, and the moving point on it."""
    unit = _millimetres(design)
    x, y = (axis * unit for axis in design.target.axes)
    height = 0.6 * float(np.ptp(x))
    rec.log(path, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    log_surface(rec, f"{path}/surface", x, y, value.reshape(design.target.shape).T, height)
    samples = design.source.potential.samples * unit
    on = single(np.column_stack([samples, np.full(len(samples), 0.01 * height)]))
    rec.log(f"{path}/samples", rr.Points3D(on, colors=palette.WHITE, radii=ui(1.5)), static=True)
    way = np.column_stack([design.way.states.q_m * unit, height * (along + 0.02)])
    columns = rr.Points3D.columns(positions=single(way))
    log_over_time(rec, f"{path}/now", design.source.t_s, columns, _MOVING, counts=np.ones(len(way)))


def _blueprint(design: JointDesign, planar: bool) -> rrb.Blueprint:
    name = design.source.name
    titles = {TRUSS: f"{name}: the truss over the recorded motion", V: f"{name}: potential V_z"}
    titles[U] = "strain energy U, cut at 1"
    views = {
        path: rrb.Spatial3DView(origin=path, name=title, background=palette.GROUND) for path, title in titles.items()
    }
    along = rrb.TimeSeriesView(origin=ENERGY, name="V_z and U along the motion")
    rows = [rrb.Horizontal(views[V], views[U])] if planar else []
    rows.append(rrb.Horizontal(views[TRUSS], along))
    return screen(rrb.Vertical(*rows, name=name))
