"""What a person reads first of a run."""

import pytest

from mocap.report.summary import error_lines


@pytest.mark.parametrize(
    ("z", "said"), [(0.7, "too wide"), (0.9, None), (1.15, None), (1.3, "too narrow"), (None, None)]
)
def test_intervals_that_are_not_believable_are_said_to_be(z, said):
    """By the root mean square of error over stated standard deviation in hidden gaps, with the number."""
    own = {"rmse_mm": 2.0, "coverage95": 91.0, "z": z}
    report = {
        "model": {"name": "mixture"},
        "validation": {"methods": {"mixture": own, "linear": {"rmse_mm": 20.0}}, "hidden_samples": 400},
        "sd_mm": {"filled": {"50%": 1.0}},
    }
    lines = [line for line in error_lines(report) if line.startswith("intervals are")]
    assert len(lines) == (said is not None)
    assert all(said in line and f"{z:.2f} times" in line for line in lines)


@pytest.mark.parametrize(("count", "said"), [(0, None), (1, "1 extrapolated point "), (12, "12 extrapolated points ")])
def test_extrapolated_points_are_counted(count, said):
    """One is a point, twelve are points, none is not said."""
    own = {"rmse_mm": 2.0, "coverage95": 91.0, "z": 1.0}
    report = {
        "model": {"name": "mixture"},
        "validation": {"methods": {"mixture": own}, "hidden_samples": 400},
        "sd_mm": {"filled": {"50%": 1.0}},
        "extrapolated": count,
    }
    lines = [line for line in error_lines(report) if "extrapolated" in line]
    assert len(lines) == (said is not None)
    assert all(line.startswith(said) for line in lines)


def test_hidden_points_that_only_other_models_filled_are_told():
    """Of a long recording one block is validated; where it shows too little for the model, that is said."""
    report = {
        "model": {"name": "learned"},
        "validation": {"methods": {"linear": {"rmse_mm": 2.72}, "cubic": {"rmse_mm": 1.54}}, "hidden_samples": 40},
        "sd_mm": {"filled": {"50%": 1.0}},
    }
    assert error_lines(report) == [
        "not measured for learned model: 40 points could be hidden only where too little is seen for it; other methods "
        "there: cubic splines 1.54, straight lines 2.72 mm"
    ]
    assert error_lines({**report, "validation": {}}) == ["not measured: no points were hidden"]
