"""``res.plot``: figures of a tracked recording, on matplotlib axes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mocap.errors import MocapError
from mocap.kinematics.cycles import Cycle, Ensemble, Footfalls, counted, ensemble
from mocap.kinematics.records import Kinematics
from mocap.plots import kinematics as plots
from mocap.plots.animal import draw_animal
from mocap.tracking.result import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def shown(given: "Axes | None", ax: "Axes") -> "Axes":
    """Axes, whose figure pyplot shows where it was made for them: a notebook then shows it below the cell."""
    figure = ax.get_figure(root=True)
    if given is None and figure is not None:
        from matplotlib import pyplot

        canvas = pyplot.figure(figsize=figure.get_size_inches()).canvas
        canvas.figure = figure  # in place of pyplot's own: before 3.11 it shows no others
        figure.set_canvas(canvas)
    return ax


@dataclass(frozen=True, eq=False)
class Plots:
    """Figures of a tracked recording; every method draws on ``ax`` or on new axes, and returns them."""

    run: Result
    kinematics: Kinematics
    rows: Sequence[Cycle]
    steps: Footfalls | None

    def __repr__(self) -> str:
        """What there is to draw."""
        methods = ", ".join(name for name in vars(type(self)) if name[0] != "_" and callable(getattr(self, name)))
        return f"<Plots of {self.run.name!r}: {methods}>"

    def __call__(self) -> "Figure":
        """The animal; the other figures are methods."""
        return self.animal()

    def over_time(self, *quantities: str, ax: "Axes | None" = None) -> "Axes":
        """Quantities of one unit over time with 95 % intervals; filled frames are shaded.

        Raises:
            MocapError: there is no quantity of that name, or they differ in unit.
        """
        units = {self.kinematics[name].unit for name in quantities}
        if len(units) != 1:
            raise MocapError(
                f"quantities of one plot need one unit, but these have {', '.join(sorted(units)) or 'none'}"
            )
        return shown(ax, plots.plot_over_time(self.kinematics, quantities, ax=ax))

    def curves(self, quantity: str, *, of: str) -> Ensemble:
        """A quantity over the phase of the cycles of a limb or foot that are not doubtful: mean, interval, each cycle.

        Raises:
            MocapError: there is no such quantity, or no cycles of that.
        """
        own = [row for row in self.rows if row.of == of]
        rows = counted(own)
        if own and not rows:
            raise MocapError(f"all {len(own)} cycles of {of!r} are doubtful: `cycles` says why, in the column `reason`")
        if not rows:
            parts = ", ".join(dict.fromkeys(row.of for row in self.rows)) or "none"
            raise MocapError(f"there are no cycles of {of!r}: there are {parts}; state strokes or feet in the skeleton")
        return ensemble(self.kinematics, rows, quantity)

    def by_phase(self, *quantities: str, of: str, ax: "Axes | None" = None) -> "Axes":
        """Quantities over the phase of the cycles of a limb: mean with its 95 % interval, and each cycle.

        Raises:
            MocapError: as ``curves``.
        """
        curves = [self.curves(name, of=of) for name in quantities]
        return shown(
            ax, plots.plot_by_phase(curves, unit=self.kinematics[quantities[0]].unit, of=of.replace("_", " "), ax=ax)
        )

    def gait(self, ax: "Axes | None" = None) -> "Axes":
        """Gait diagram.

        Raises:
            MocapError: no feet are stated, or none stands.
        """
        if self.steps is None:
            raise MocapError("there is no gait diagram: state `feet` under [measures] in the skeleton")
        return shown(ax, plots.plot_gait(self.steps, ax=ax))

    def stroke(self, name: str, ax: "Axes | None" = None) -> "Axes":
        """Path of a limb in and out of its stroke plane.

        Raises:
            MocapError: there is no such stroke.
        """
        rows = [row for row in counted(self.rows) if row.of == name]
        return shown(ax, plots.plot_stroke_path(self.kinematics, name, rows, ax=ax))

    def animal(self) -> "Figure":
        """The animal at three phases of its motion, markers measured and filled, and the path of its body."""
        return draw_animal(self.run)

    def gaps(self, ax: "Axes | None" = None) -> "Axes":
        """Where markers were filled, rejected or missing."""
        markers = self.run.tracks
        return shown(ax, plots.plot_gaps(markers.names, markers.t_s, markers.status, ax=ax))

    def residuals(self, ax: "Axes | None" = None) -> "Axes":
        """Distances of each camera's pixels from the tracked markers.

        Raises:
            MocapError: the recording has no cameras.
        """
        if not self.run.cameras:
            raise MocapError("there are no residuals: the recording was given as positions, without cameras")
        away = np.linalg.norm(self.run.ideal_px - self.run.reprojected_px, axis=-1)
        return shown(ax, plots.plot_residuals(self.run.camera_names, away, self.run.used, ax=ax))
