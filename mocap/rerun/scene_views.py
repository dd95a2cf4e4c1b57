"""Views in three dimensions: where the eye stands, the ground, and how long the trails are."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from eal.arrays import Array
from mocap.rerun import palette, paths
from mocap.rerun.columns import FRAME
from mocap.rerun.layout import Layout
from mocap.rerun.log_markers import ELLIPSOID_SD, grid_spacing_m

WHISKER_SCALE = 10.0
"""Residual whiskers are so many times longer than the residuals, to be seen without zooming in."""
_WIDE_TILES = 9
"""More cameras have too little room for a title of their scale."""


def scene_view(layout: Layout) -> rrb.View:
    """The scene, the eye moves with the body; the title is the legend."""
    name = f"Measured blue, filled yellow, rejected red; {ELLIPSOID_SD:g} sd; trails left purple, right orange"
    return _world_view(layout, name, follow=True)


def names_view(layout: Layout) -> rrb.View:
    """The same with the names of the markers, without trails."""
    return _world_view(layout, "With names of markers", named=True, follow=True)


def rig_view(layout: Layout) -> rrb.View:
    """The scene from so far away that all cameras are in sight."""
    scene = layout.scene
    away_m = [float(np.linalg.norm(c.position_m - scene.centre_m)) for c in scene.cameras]
    return _world_view(layout, "Where the cameras stand (m)", 2.6 * max([scene.radius_m, *away_m]))


def eye(
    centre: Array, distance: float, up: Array, *, rise: float = 0.45, follow: str | None = None
) -> rrb.EyeControls3D:
    """An eye that looks at a point from the front, a little from the right and from above.

    Args:
        centre: (3,) point to look at.
        distance: From the point to the eye.
        up: (3,) signed axis.
        rise: How steeply it looks down: tangent of the angle.
        follow: An entity that it moves with.
    """
    axis = int(np.argmax(np.abs(up)))
    right = np.eye(3)[0 if axis != 0 else 1]
    front = -np.cross(up, right)
    direction = (0.45 * right + 0.9 * front) + rise * up
    position = centre + distance * direction / np.linalg.norm(direction)
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital, position=position, look_target=centre, eye_up=up, tracking_entity=follow
    )


def last_frames(n_frames: int) -> rrb.VisibleTimeRanges:
    """What was logged in the last frames up to the cursor."""
    start = rrb.TimeRangeBoundary.cursor_relative(seq=-n_frames)
    return rrb.VisibleTimeRanges(
        [rrb.VisibleTimeRange(FRAME, start=start, end=rrb.TimeRangeBoundary.cursor_relative())]
    )


def _world_view(
    layout: Layout, name: str, distance_m: float = 1.0, *, named: bool = False, follow: bool = False
) -> rrb.View:
    """The scene from a distance; an eye that follows takes its own."""
    scene = layout.scene
    cameras = [paths.image(camera.name) for camera in scene.cameras]
    return world_view(
        paths.WORLD,
        name,
        contents=[
            *(
                paths.SKELETON,
                paths.FRAMED,
                paths.PATH,
                paths.AXES,
                *((paths.TRAILS,) if not named else ()),
                f"{paths.MARKERS}/**",
                f"{paths.UNCERTAINTY}/**",
            ),
            *cameras,
        ],
        ground=(scene.up, scene.ground_m, scene.radius_m),
        look=eye(scene.centre_m, distance_m, scene.up, follow=paths.FRAMED if follow else None),
        trail=(paths.TRAILS, layout.scene_trail_frames),
        frusta=cameras,
        named=paths.SKELETON if named else None,
    )


def world_view(
    origin: str,
    name: str,
    *,
    contents: Sequence[str],
    ground: tuple[Array, float, float],
    look: rrb.EyeControls3D,
    trail: tuple[str, int],
    frusta: Sequence[str] = (),
    named: str | None = None,
) -> rrb.View:
    """Things over a ground.

    Args:
        origin: Entity whose space it is.
        name: Title.
        contents: What to show.
        ground: The signed axis that points up, the height of the ground along it, and the radius of what is shown.
        look: The eye.
        trail: The entity that is shown of several frames, and of how many.
        frusta: Cameras that are shown as frusta alone, without the arrows of their axes.
        named: Points whose names are shown.
    """
    up, height_m, radius_m = ground
    return rrb.Spatial3DView(
        origin=origin,
        name=name,
        contents=list(contents),
        background=palette.GROUND,
        line_grid=rrb.LineGrid3D(
            visible=True,
            spacing=grid_spacing_m(radius_m),
            plane=rr.components.Plane3D(up, height_m),
            color=(*palette.DIM, 70),
        ),
        eye_controls=look,
        overrides={
            trail[0]: last_frames(trail[1]),
            **{camera: rr.Pinhole.from_fields().visualizer() for camera in frusta},
            **({named: rr.Points3D.from_fields(show_labels=True)} if named else {}),
        },
    )


def camera_view(layout: Layout, name: str) -> rrb.View:
    """One camera: its pixels, and the body as the viewer itself projects it; framed on what it saw."""
    (left, top), (right, bottom) = layout.bounds_px[name]
    return rrb.Spatial2DView(
        origin=paths.image(name),
        name=f"{name} (px, residuals {WHISKER_SCALE:g}x)" if len(layout.bounds_px) <= _WIDE_TILES else f"{name} (px)",
        contents=["$origin/**", paths.SKELETON, f"{paths.MARKERS}/filled"],
        overrides={f"{paths.MARKERS}/filled": rr.Points3D.from_fields(radii=rr.components.Radius.ui_points(3.0))},
        background=palette.GROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=[left, right], y_range=[top, bottom]),
    )


def camera_order(layout: Layout) -> list[str]:
    """Cameras with pixels in the order of the recording."""
    return [c.name for c in layout.scene.cameras if c.name in layout.bounds_px]
