"""What all tests share: the root on the path, property tests of one verdict, and who runs what in parallel."""

import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # `tests.reference` and `tests.real_data`, however pytest was started

settings.register_profile(
    "project", deadline=None, derandomize=True, max_examples=40, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("project")


SLOW = {
    "benchmarks/gaps/test_gap_ours.py",
    "benchmarks/gaps/test_gap_run.py",
    "benchmarks/gaps/test_gap_sets.py",
    "benchmarks/gaps/test_peer_latent.py",
    "benchmarks/gaps/test_peer_poses.py",
    "datasets/test_calibration_pictures.py",
    "datasets/test_catalogue.py",
    "datasets/test_interior_gaps.py",
    "datasets/test_twin_motion.py",
    "eal/joint_design/test_design_truss.py",
    "eal/joint_design/test_snap_through.py",
    "eal/joint_design/test_truss_equilibrium.py",
    "eal/test_errata.py",
    "eal/test_integrators.py",
    "eal/test_reproduce.py",
    "eal/test_systems.py",
    "filters/test_bones.py",
    "filters/test_delayed.py",
    "filters/test_gap_law.py",
    "filters/test_learned_model.py",
    "filters/test_live.py",
    "filters/test_mechanics_identified.py",
    "filters/test_mixture.py",
    "filters/test_observe.py",
    "filters/test_recording_alone.py",
    "filters/test_registry.py",
    "filters/test_several.py",
    "filters/test_shape_mechanics.py",
    "mocap/joint_design/test_design_joint.py",
    "mocap/rerun/test_view_compare.py",
    "mocap/rerun/test_view_ends.py",
    "mocap/rerun/test_view_hover.py",
    "mocap/rerun/test_view_live.py",
    "mocap/rerun/test_view_pictures.py",
    "mocap/rerun/test_view_recording.py",
    "mocap/rerun/test_view_share.py",
    "mocap/rerun/test_view_video.py",
    "mocap/test_absurd_values.py",
    "mocap/test_audit.py",
    "mocap/test_audit_reports.py",
    "mocap/test_calibrate.py",
    "mocap/test_calibrate_boards.py",
    "mocap/test_calibrate_wand.py",
    "mocap/test_camera_health.py",
    "mocap/test_cli.py",
    "mocap/test_click_noise.py",
    "mocap/test_convert.py",
    "mocap/test_film_extra.py",
    "mocap/test_format_files.py",
    "mocap/test_format_roundtrips.py",
    "mocap/test_fuzzed_files.py",
    "mocap/test_learning.py",
    "mocap/test_library.py",
    "mocap/test_main_job.py",
    "mocap/test_movement_package.py",
    "mocap/test_odd_tables.py",
    "mocap/test_optical_files.py",
    "mocap/test_output.py",
    "mocap/test_project_source.py",
    "mocap/test_propose_skeleton.py",
    "mocap/test_ray_bias.py",
    "mocap/test_stated_noise.py",
    "mocap/test_swapped_names.py",
    "mocap/test_trouble.py",
    "mocap/test_unstated_unit.py",
    "test_installed.py",
}
"""Files that take more than 2 to 4 s (``--durations``); ``make quick`` leaves them out."""


def pytest_collection_modifyitems(items: Sequence[pytest.Item]) -> None:
    """A file runs on one worker, as its fixtures are made once; so do all that show something on a screen."""
    for item in items:
        group = "view" if item.path.parent == ROOT / "tests" / "mocap" / "rerun" else str(item.path)
        item.add_marker(pytest.mark.xdist_group(group))
        if item.path.relative_to(ROOT / "tests").as_posix() in SLOW:
            item.add_marker(pytest.mark.slow)


@pytest.fixture
def mocap(monkeypatch, capsys):
    """Exit code, stdout and stderr of a command in this process."""
    from mocap.cli.main import main

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["mocap", *map(str, arguments)])
        with pytest.raises(SystemExit) as stopped:
            main()
        out, err = capsys.readouterr()
        return int(stopped.value.code or 0), out, err

    return run
