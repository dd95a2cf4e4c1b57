"""Released tools: what runs in their environment does what it is said to; without it they are skipped with a line."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.gaps.peers import released
from benchmarks.gaps.peers.coordinates import World
from benchmarks.gaps.peers.released.make_env import interpreter
from benchmarks.gaps.peers.released.tools import ToolFiller, tools
from tests.benchmarks.gaps.peer_trials import hidden, make_trial

needs_env = pytest.mark.skipif(not interpreter().exists(), reason="python -m benchmarks.gaps.peers.released.make_env")


def test_without_the_environment_each_is_skipped_with_a_line(monkeypatch, tmp_path, capsys):
    """One line a method on stderr that names it and says what to run."""
    monkeypatch.setattr(released, "interpreter", lambda: tmp_path / "python")
    assert released.peers() == []
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(":")[0] for line in lines] == [method.name for method in tools()]
    assert all("make_env" in line for line in lines)


@needs_env
@pytest.mark.parametrize(
    ("tool", "options", "tolerance_m"),
    [
        ("pose2sim", {"filter": "butterworth", "kind": "cubic", "cutoff_hz": 20}, 1e-4),
        ("pykalman", {"density": 1e-4}, 1e-3),
    ],
)
def test_a_slow_curve_is_filled(tool, options, tolerance_m):
    """A parabola of 1 m in a second, ten frames of it hidden: a cubic has it, a velocity is off by (5 dt)^2 / 2."""
    t = np.arange(100) / 100
    limbs = (t**2)[:, None, None] * np.random.default_rng(0).normal(size=(1, 6, 3)) / 3
    trial = make_trial(limbs, sd_m=1e-5)
    shown = replace(trial, xyz_m=hidden(trial, ("a",), np.arange(45, 55)))
    filled = ToolFiller(tool, World(), options)(shown)
    np.testing.assert_allclose(filled.xyz_m[:, 4], trial.xyz_m[:, 4], atol=tolerance_m)
