"""What a person reads first of a run: what is wrong, what error to expect in gaps, how long the animal is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scipy.special import ndtri

from eal.arrays import Z95
from mocap.filters.models.named import TITLES
from mocap.io.unstated_unit import length_text
from mocap.text import number_of

METHODS = {
    **{name: (one.title, one.about) for name, one in TITLES.items()},
    "mixture": ("mixture", "pose model and constant velocity, weighted by each model's predicted variance"),
    "learned": ("learned model", "the model that mocap learn wrote"),
    "one camera": ("one camera", "the most probable motion under the poses of other trials"),
    "conditional_gaussian": ("conditional Gaussian", "regression on the other markers of the same frame"),
    "principal_components": ("principal components", "the same from a few components of all poses"),
    "chains": ("chains of bones", "directions of bones through splines, lengths constant, outward from the trunk"),
    "linear": ("straight lines", "linear interpolation of each coordinate"),
    "cubic": ("cubic splines", "a spline through each coordinate"),
    "triangulation": ("triangulation", "each frame by itself, without a motion model"),
}
"""What the methods of the tables are called, and what they do, by their key in ``report.json``."""

HIDDEN = "measured points that were hidden"
ACROSS = "hidden pixels, across the line of sight"
"""What filled points are compared with, of several cameras and of one."""
BELIEVABLE = tuple(Z95 / float(ndtri((1 + share) / 2)) for share in (0.98, 0.90))
"""Of error over stated standard deviation (rms), 0.84 and 1.19: so far an interval that should hold 95 % holds 98 or 90
%."""


@dataclass(frozen=True, kw_only=True)
class Expected:
    """What error to expect in gaps.

    Attributes:
        rmse: Root mean square distance from what was hidden, in ``unit``.
        coverage: Per cent of coordinates inside their 95 % intervals; None: not known.
        z: Root mean square of error over stated standard deviation; None: not known.
        half_width: Half of the median 95 % interval of a filled coordinate, in ``unit``; None: nothing was filled.
        samples: How many were hidden.
        against: What they were compared with.
        others: The same distance by other methods, best first.
        unit: ``mm`` or ``px``.
    """

    rmse: float
    coverage: float | None
    z: float | None
    half_width: float | None
    samples: int
    against: str
    others: Mapping[str, float]
    unit: str

    @property
    def wrong_by(self) -> str | None:
        """``narrow`` or ``wide``: what stated intervals are; None: right, or not known."""
        if self.z is None or BELIEVABLE[0] <= self.z <= BELIEVABLE[1]:
            return None
        return "narrow" if self.z > 1 else "wide"


def expected_error(report: Mapping) -> Expected | None:
    """What error to expect in gaps; None: nothing was hidden, or none of it was filled."""
    unit, true = unit_of(report), "gaps" in report
    methods = report["gaps"] if true else report.get("validation", {}).get("methods", {})
    own = methods.get(report.get("model", {}).get("name"), {})
    rmse = own.get(f"rmse_{unit}")
    if not isinstance(rmse, float):
        return None
    width = report[f"sd_{unit}"]["filled"]["50%"]
    errors = {name: m[f"rmse_{unit}"] for name, m in methods.items() if name != report["model"]["name"]}
    return Expected(
        rmse=rmse,
        coverage=own["coverage95"],
        z=own.get("z"),
        half_width=None if width is None else Z95 * width,
        samples=report["gap_samples"] if true else report["validation"]["hidden_samples"],
        against="ground truth" if true else report["validation"].get("against", HIDDEN),
        others={name: e for name, e in sorted(errors.items(), key=lambda one: one[1] or 0.0) if e is not None},
        unit=unit,
    )


def unit_of(report: Mapping) -> str:
    """Unit of lengths in a report: ``mm``, of one video without a scale ``px``."""
    return "px" if report.get("plane", {}).get("unit") == "px" else "mm"


def two_digits(value: float) -> str:
    """A positive number as people write it: ``0.35``, ``240``, never ``2.4e+02``."""
    return f"{float(f'{value:.2g}'):.10g}"


def method(name: str) -> str:
    """What a method of a report is called."""
    return METHODS[name][0] if name in METHODS else name


def error_lines(report: Mapping) -> list[str]:
    """The error to expect in gaps: three numbers, and how other methods fare."""
    found = expected_error(report)
    if found is None:
        hidden = report.get("validation", {}).get("hidden_samples")
        return ["not measured: no points were hidden" if not hidden else _other_models(report, hidden)]
    unit = found.unit
    lines = [f"{found.rmse:.3g} {unit} RMS error of {found.samples} filled points against {found.against}"]
    if found.coverage is not None:
        lines.append(f"{found.coverage:.1f} % of their 95 % intervals contain the value (95 % expected)")
    if found.half_width is not None:
        lines.append(f"± {two_digits(found.half_width)} {unit} is the median 95 % interval of a filled coordinate")
    if report.get("extrapolated"):
        points = number_of(report["extrapolated"], "extrapolated point")
        lines.append(f"{points} before a marker's first or after its last observation: no later data constrain them")
    if found.wrong_by is not None:
        lines.append(f"intervals are too {found.wrong_by}: errors are {found.z:.2f} times the stated sd (1 is right)")
    if found.others:
        lines.append(
            "other methods: " + ", ".join(f"{method(k)} {e:.3g}" for k, e in found.others.items()) + f" {unit}"
        )
    return lines


def _other_models(report: Mapping, hidden: int) -> str:
    """How hidden points were filled where they were too few for the model that was used."""
    unit = unit_of(report)
    errors = {name: one[f"rmse_{unit}"] for name, one in report["validation"]["methods"].items()}
    others = ", ".join(
        f"{method(name)} {error:.3g}" for name, error in sorted(errors.items(), key=lambda one: one[1]) if error
    )
    return (
        f"not measured for {method(report['model']['name'])}: {number_of(hidden, 'point')} could be hidden only where "
        f"too little is seen for it; other methods there: {others} {unit}"
    )


def better(report: Mapping) -> str | None:
    """A sentence where another model of this program clearly fills hidden points better than the one that was used.

    The mean square of n errors is known to sqrt(2 / n) of itself, their root to half of that: two root mean squares
    differ where they are two standard deviations of their difference apart, 2 / sqrt(n).
    """
    found = expected_error(report)
    models = () if found is None else [name for name in found.others if name in TITLES and TITLES[name].posed]
    if found is None or not models or found.others[models[0]] >= found.rmse * (1 - 2 / max(found.samples, 4) ** 0.5):
        return None
    best = models[0]
    return (
        f"--model {best} fills the hidden points better ({found.others[best]:.3g} {found.unit}) than the model used "
        f"({method(report['model']['name'])}, {found.rmse:.3g} {found.unit})"
    )


def length_line(report: Mapping) -> str:
    """How long the animal is, by which a wrong unit shows."""
    if report.get("length_m") is None:
        return "length not known: no frame shows two markers"
    if "plane" in report:
        return f"{report['length_m'] * 1e3:.3g} {unit_of(report)} between its two most distant markers (median)"
    return f"{length_text(report['length_m'])} between its two most distant markers (median); wrong? give --unit"


def notes(report: Mapping) -> Sequence[str]:
    """Findings that ask for nothing: what was decided, rejected or repaired."""
    told = {*report.get("wrong", ()), *report.get("open", ())}
    return [sentence for sentence in report.get("findings", ()) if sentence not in told]
