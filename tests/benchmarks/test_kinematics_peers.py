"""Velocities of the smoother's state beside a filter that is tuned on the truth."""

from benchmarks.kinematics import velocity_errors


def test_velocities_beat_a_tuned_filter_in_a_short_recording():
    """120 frames, noise of 0.5 mm: less error than the best of three filters that are tuned on the truth."""
    ours, *others = velocity_errors("lizard", n_frames=120, noise_m=5e-4).values()
    assert ours < min(others)
