"""Released tools: what runs in their environment does what it is said to; without it they are skipped with a line."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.gaps.peers import released
from benchmarks.gaps.peers.coordinates import World
from benchmarks.gaps.peers.released.disk import Disk, installed
from benchmarks.gaps.peers.released.make_env import interpreter
from benchmarks.gaps.peers.released.tools import ToolFiller, bones, tools
from tests.benchmarks.gaps.peer_trials import hidden, make_trial

needs_env = pytest.mark.skipif(not interpreter().exists(), reason="python -m benchmarks.gaps.peers.released.make_env")


def test_without_the_environment_each_is_skipped_with_a_line(monkeypatch, tmp_path, capsys):
    """One line a method on stderr that names it and says what to run."""
    monkeypatch.setattr(released, "interpreter", lambda: tmp_path / "python")
    assert released.peers() == []
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(":")[0] for line in lines] == [method.name for method in tools()]
    assert all("make_env" in line for line in lines)


def test_bones_are_the_stiff_pairs():
    """Two markers at one distance are a bone; pairs that move are not."""
    rng = np.random.default_rng(0)
    limbs = rng.normal(size=(100, 6, 3))
    limbs[:, 1] = limbs[:, 0] + [0.1, 0.0, 0.0]
    trial = make_trial(limbs)
    stiff = [{trial.names[i] for i in pair} for pair in bones([trial])]
    assert {"a", "b"} in stiff
    assert all(pair == {"a", "b"} or pair < {"chest", "hip_l", "hip_r", "tail"} for pair in stiff)


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


@needs_env
def test_what_a_tool_says_of_wrong_options_is_passed_on():
    """An error in the other process is an ArithmeticError with its message; the process goes on."""
    trial = make_trial(np.zeros((30, 6, 3)))
    with pytest.raises(ArithmeticError, match=r"pose2sim: KeyError"):
        ToolFiller("pose2sim", World(), {"filter": "none", "kind": "cubic"})(trial)


@pytest.mark.skipif(not installed(), reason="python -m benchmarks.gaps.peers.released.make_env --disk")
def test_disk_fills_what_its_window_holds():
    """A gap within the window is the network's, one beyond it the straight line between its ends; the rest is kept."""
    limbs = np.cumsum(np.random.default_rng(0).normal(0, 1e-2, (170, 6, 3)), axis=0)
    trial = make_trial(limbs, sd_m=1e-3)
    shown = replace(trial, xyz_m=hidden(trial, ("a",), np.arange(60, 120)))
    shown = replace(shown, xyz_m=np.where(np.isfinite(shown.xyz_m), hidden(trial, ("b",), np.arange(75, 100)), np.nan))
    filled = Disk("transformer", steps=1).learn([trial])(shown).xyz_m
    seen = np.isfinite(shown.xyz_m)
    np.testing.assert_allclose(filled[seen], trial.xyz_m[seen], atol=1e-9)
    a, b = trial.names.index("a"), trial.names.index("b")
    lines = {m: np.linspace(filled[i, m], filled[j, m], j - i + 1) for m, i, j in ((a, 59, 120), (b, 74, 100))}
    np.testing.assert_allclose(filled[59:121, a], lines[a], atol=1e-6)
    assert np.isfinite(filled).all()
    assert np.abs(filled[75:100, b] - lines[b][1:-1]).max() > 1e-3
