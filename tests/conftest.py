"""What all tests share: the root on the path, property tests of one verdict, and who runs what in parallel."""

import os
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from typer.main import get_command

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # `tests.reference` and `tests.real_data`, however pytest was started

os.environ.setdefault("MOCAP_JOBS", "1")  # tests run side by side already
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # processes that tests start would each compile all of mocap again
sys.dont_write_bytecode = False
# what JAX compiled in an earlier run is read; a folder a worker, as it writes files without a lock
WORKER = os.environ.get("PYTEST_XDIST_WORKER", "alone")
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(ROOT / ".pytest_cache" / "jax" / WORKER))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
settings.register_profile(
    "project", deadline=None, derandomize=True, max_examples=40, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("project")


SLOW = {
    "benchmarks/test_compare_benchmark.py": 25,
    "benchmarks/gaps/test_gap_ours.py": 4,
    "benchmarks/gaps/test_gap_run.py": 4,
    "benchmarks/gaps/test_gap_sets.py": 4,
    "benchmarks/gaps/test_peer_poses.py": 3,
    "datasets/test_calibration_pictures.py": 3,
    "mocap/test_board_corners.py": 20,
    "datasets/test_catalogue.py": 2,
    "datasets/test_disturbances.py": 2,
    "datasets/test_movies.py": 2,
    "datasets/test_twin_motion.py": 2,
    "eal/joint_design/test_design_truss.py": 27,
    "eal/joint_design/test_snap_through.py": 12,
    "eal/joint_design/test_truss_equilibrium.py": 2,
    "eal/test_choice.py": 4,
    "eal/test_comparison.py": 12,
    "eal/test_errata.py": 9,
    "eal/test_integrators.py": 4,
    "eal/test_radius.py": 6,
    "eal/test_reproduce.py": 52,
    "filters/test_animal.py": 8,
    "filters/test_articulated_motion.py": 6,
    "filters/test_bending_bodies.py": 8,
    "filters/test_bones.py": 4,
    "filters/test_dark_frames.py": 2,
    "filters/test_delayed.py": 6,
    "filters/test_gap_law.py": 2,
    "filters/test_gaps_in_trials.py": 2,
    "filters/test_gaussian_process.py": 2,
    "filters/test_groups.py": 3,
    "filters/test_learned_model.py": 30,
    "filters/test_limb_potential.py": 4,
    "filters/test_live.py": 6,
    "filters/test_mixture.py": 3,
    "filters/test_observe.py": 5,
    "filters/test_one_camera.py": 22,
    "filters/test_one_more_ray.py": 7,
    "filters/test_recording_alone.py": 4,
    "filters/test_rigid.py": 3,
    "filters/test_roughness.py": 2,
    "filters/test_shape_mechanics.py": 2,
    "mocap/batches/test_batch.py": 45,
    "mocap/batches/test_trial_limits.py": 9,
    "mocap/desk/test_desk.py": 34,
    "mocap/desk/test_desk_access.py": 20,
    "mocap/desk/test_desk_one_camera.py": 5,
    "mocap/desk/test_desk_rooms.py": 40,
    "mocap/desk/test_proof.py": 2,
    "mocap/desk/test_session.py": 17,
    "mocap/digitising/test_digitise.py": 10,
    "mocap/digitising/test_kinds.py": 3,
    "mocap/digitising/test_label.py": 5,
    "mocap/digitising/test_texture.py": 4,
    "mocap/joint_design/test_design_joint.py": 26,
    "mocap/kinematics/test_body_joints.py": 4,
    "mocap/kinematics/test_frequency.py": 7,
    "mocap/kinematics/test_figures.py": 5,
    "mocap/kinematics/test_cycle_checks.py": 5,
    "mocap/kinematics/test_functional.py": 5,
    "mocap/kinematics/test_moments.py": 2,
    "mocap/test_one_camera_entrances.py": 20,
    "mocap/test_pages_run.py": 60,
    "mocap/test_mobility.py": 20,
    "mocap/test_parts.py": 20,
    "mocap/rerun/test_view_angles.py": 2,
    "mocap/rerun/test_view_digitised.py": 27,
    "test_imported_names.py": 17,
    "mocap/rerun/test_view_ends.py": 10,
    "mocap/rerun/test_view_hover.py": 7,
    "mocap/rerun/test_view_lagrangian.py": 2,
    "mocap/rerun/test_view_limbs.py": 2,
    "mocap/rerun/test_view_pictures.py": 26,
    "mocap/rerun/test_view_recording.py": 9,
    "mocap/rerun/test_view_share.py": 35,
    "mocap/rerun/test_view_video.py": 12,
    "mocap/test_entrances.py": 20,
    "mocap/test_one_list.py": 20,
    "mocap/test_left_positions.py": 8,
    "mocap/test_across_trials.py": 8,
    "mocap/test_frame_rates.py": 6,
    "mocap/test_compare_joints.py": 4,
    "mocap/test_earlier_results.py": 4,
    "mocap/test_absurd_values.py": 3,
    "mocap/test_arrangement.py": 7,
    "mocap/test_arrays.py": 3,
    "mocap/test_audit.py": 3,
    "mocap/test_audit_reports.py": 2,
    "mocap/test_blocks.py": 13,
    "mocap/test_by_hand.py": 4,
    "mocap/test_calibrate.py": 9,
    "mocap/test_calibrate_apart.py": 6,
    "mocap/test_calibrate_boards.py": 12,
    "mocap/test_calibrate_dlt.py": 5,
    "mocap/test_calibrate_wand.py": 6,
    "mocap/test_calibration_tables.py": 3,
    "mocap/test_camera_health.py": 3,
    "mocap/test_cli.py": 10,
    "mocap/test_convert.py": 2,
    "mocap/test_crop_offsets.py": 2,
    "mocap/test_edits.py": 6,
    "mocap/test_few_frames.py": 6,
    "mocap/test_fit_lens.py": 3,
    "mocap/test_foreign_results.py": 2,
    "mocap/test_format_files.py": 2,
    "mocap/test_format_roundtrips.py": 4,
    "mocap/test_fuzzed_files.py": 2,
    "mocap/test_joint_filter.py": 13,
    "mocap/test_jumps.py": 5,
    "mocap/test_learning.py": 23,
    "mocap/test_library.py": 8,
    "mocap/test_likelihoods.py": 3,
    "mocap/test_main_job.py": 14,
    "mocap/test_many.py": 4,
    "mocap/test_model_settings.py": 4,
    "mocap/test_movement_package.py": 12,
    "mocap/test_numbers_that_cannot_be.py": 6,
    "mocap/test_nwb.py": 2,
    "mocap/test_odd_tables.py": 3,
    "mocap/test_optical_files.py": 4,
    "mocap/test_output.py": 10,
    "mocap/test_propose_skeleton.py": 8,
    "mocap/test_record.py": 3,
    "mocap/test_side_by_side.py": 22,
    "mocap/test_stated_noise.py": 2,
    "mocap/test_strangers_and_orphans.py": 25,
    "mocap/test_strangers_formats.py": 2,
    "mocap/test_strangers_versions.py": 3,
    "mocap/test_swap_states.py": 3,
    "mocap/test_swapped_names.py": 6,
    "mocap/test_tampered_records.py": 10,
    "mocap/test_track_one_camera.py": 3,
    "mocap/test_trouble.py": 8,
    "mocap/test_two_rays.py": 10,
    "mocap/test_unstated_unit.py": 3,
    "mocap/test_views_of_a_trial.py": 2,
    "mocap/test_wrong_accusations.py": 2,
    "mocap/web/test_web_server.py": 8,
    "test_installed.py": 40,
    "test_plugins.py": 20,
    "test_satellites.py": 70,
    "test_time_limit.py": 4,
}
"""Files that take more than three seconds of processor time, with roughly how many; ``make quick`` leaves them out.

Tests in them that are marked ``quick`` stay: a short main job, the command line, learning, the viewer. Tests elsewhere
that take more than 1.5 seconds are marked ``slow`` themselves.
"""
RARE = {
    "installs packages, or takes one away, and runs what other tests run": (
        "test_installed.py",
        "test_plugins.py",
        "test_satellites.py",
    ),
    "runs the commands of pages, each of which has tests of its own": (
        "mocap/test_pages_run.py",
        "mocap/test_parts.py",
    ),
    "waits for processes, their limits and their ends": (
        "mocap/batches/test_batch.py",
        "mocap/batches/test_trial_limits.py",
        "mocap/test_side_by_side.py",
        "test_time_limit.py",
    ),
    "looks at the viewer's pictures, or moves a pointer over them": (
        "mocap/rerun/test_view_digitised.py",
        "mocap/rerun/test_view_ends.py",
        "mocap/rerun/test_view_hover.py",
        "mocap/rerun/test_view_pictures.py",
        "mocap/rerun/test_view_share.py",
        "mocap/rerun/test_view_video.py",
    ),
    "drives the desk's page in a browser": (
        "mocap/desk/test_desk.py",
        "mocap/desk/test_desk_access.py",
        "mocap/desk/test_desk_one_camera.py",
        "mocap/desk/test_desk_rooms.py",
        "mocap/desk/test_session.py",
    ),
    "computes the paper's figures and bounds anew": (
        "eal/test_comparison.py",
        "eal/test_errata.py",
        "eal/test_radius.py",
        "eal/test_reproduce.py",
    ),
    "designs mechanisms": (
        "eal/joint_design/test_design_truss.py",
        "eal/joint_design/test_snap_through.py",
        "mocap/joint_design/test_design_joint.py",
    ),
    "judges errors and intervals over many simulated recordings": (
        "filters/test_animal.py",
        "filters/test_articulated_motion.py",
        "filters/test_delayed.py",
        "filters/test_learned_model.py",
        "filters/test_one_camera.py",
        "filters/test_one_more_ray.py",
        "mocap/test_blocks.py",
        "mocap/test_board_corners.py",
        "mocap/test_calibrate_apart.py",
        "mocap/test_calibrate_boards.py",
        "mocap/test_joint_filter.py",
        "mocap/test_mobility.py",
        "mocap/test_propose_skeleton.py",
        "mocap/test_swapped_names.py",
        "mocap/test_two_rays.py",
    ),
    "gives every command what is broken, absurd or strange": (
        "mocap/test_few_frames.py",
        "mocap/test_numbers_that_cannot_be.py",
        "mocap/test_strangers_and_orphans.py",
        "mocap/test_tampered_records.py",
        "mocap/test_trouble.py",
    ),
    "compares with other packages": (
        "benchmarks/test_compare_benchmark.py",
        "mocap/test_movement_package.py",
    ),
}
"""Files that are slow and rarely fail, by why; ``make test`` leaves them out, and ``make test-all`` runs them, too.

Tests in them that are marked ``main`` (or ``quick``) stay: ``make test`` runs once each thing that the README names.
"""
RARE_FILES = frozenset(name for names in RARE.values() for name in names)
STAY = {"not slow": (SLOW.keys(), ("quick",)), "not rare": (RARE_FILES, ("quick", "main"))}
"""By the expression of marks: files that are left out, and the marks of tests in them that stay."""
SCREEN = "mocap/rerun/"
"""Where tests show something on a screen."""


def group_of(name: str) -> str:
    """What one worker runs: a file, as its fixtures are made once, or all that show something on a screen."""
    return SCREEN if name.startswith(SCREEN) else name


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Files without a test that is asked for are not imported: that takes each worker as long as its tests."""
    asked = config.option.markexpr
    if asked not in (*STAY, "rare") or collection_path.suffix != ".py" or collection_path.name == "conftest.py":
        return None
    name = collection_path.relative_to(ROOT / "tests").as_posix()
    if asked == "rare":
        return None if name in RARE_FILES or _has(collection_path, "rare") else True
    left_out, marks = STAY[asked]
    return True if name in left_out and not _has(collection_path, *marks) else None


def _has(path: Path, *marks: str) -> bool:
    text = path.read_text(encoding="utf-8")
    return any(f"pytest.mark.{mark}" in text for mark in marks)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks what is slow or rare, and puts what takes longest first: no worker is left with it at the end."""
    seconds: dict[str, int] = {}
    for name, long in SLOW.items():
        seconds[group_of(name)] = seconds.get(group_of(name), 0) + long
    names = {item: item.path.relative_to(ROOT / "tests").as_posix() for item in items}
    for item, name in names.items():
        marks = {mark.name for mark in item.iter_markers()}
        if name in SLOW and "quick" not in marks:
            item.add_marker(pytest.mark.slow)
        if name in RARE_FILES and not marks & {"quick", "main"}:
            item.add_marker(pytest.mark.rare)
        if "rare" in marks:
            item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: -seconds.get(group_of(names[item]), 0))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Groups are handed out whole; pytest-xdist 3.8 does not find its own marks of groups under pytest 9."""
    from xdist.scheduler import LoadScopeScheduling

    class Groups(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return group_of(nodeid.partition("::")[0].removeprefix("tests/"))

        def remove_node(self, node: Any) -> str | None:
            """As xdist does, but what ended a worker is not run again, nor given to one that is not ready: it hung."""
            units = self.assigned_work.pop(node)
            left = [(unit, name) for unit in units.values() for name, done in unit.items() if not done]
            if not left:
                return None
            unit, ended = left[0]
            unit[ended] = True
            self.workqueue.update({scope: unit for scope, unit in units.items() if not all(unit.values())})
            for other in self.assigned_work.keys() & self.registered_collections.keys():
                self._reschedule(other)
            return ended

    config.option.loadscopereorder = False
    return Groups(config, log)


@cache
def commands(app: Any) -> Any:
    """All commands as Typer builds them, once: otherwise each call takes as long as a short table."""
    return get_command(app)


@pytest.fixture
def mocap(monkeypatch, capsys):
    """Exit code, stdout and stderr of a command in this process."""
    from mocap.cli.main import main

    monkeypatch.setattr("typer.main.get_command", commands)

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["mocap", *map(str, arguments)])
        with pytest.raises(SystemExit) as stopped:
            main()
        out, err = capsys.readouterr()
        return int(stopped.value.code or 0), out, err

    return run
