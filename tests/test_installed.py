"""What is installed: the wheel alone runs the demo; extras that are absent and names that collide are told clearly."""

import json
import os
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

from mocap import load
from tests.mocap.test_main_job import assert_beats_others, assert_each_joint_has_a_potential, assert_intervals_hold

ROOT = Path(__file__).resolve().parents[1]
PACKAGES, SHIPPED = ("mocap", "eal", "filters", "datasets"), (".py", ".toml", ".html")


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The wheel, built from a copy of the sources and unpacked by pip into a folder of its own."""
    folder = tmp_path_factory.mktemp("wheel")
    wheels, target = folder / "wheels", folder / "site"
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in tracked.splitlines():
        if name.startswith(("tests/", "benchmarks/", "docs/")) or not (ROOT / name).is_file():
            continue
        (folder / "source" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "source" / name).write_bytes((ROOT / name).read_bytes())
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    subprocess.run([*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", wheels, folder / "source"], check=True)
    (wheel,) = wheels.iterdir()
    subprocess.run([*pip, "install", "--no-deps", "--target", target, wheel], check=True)
    return target


def run_there(installed: Path, cwd: Path, *words: str, first: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Python outside the repository, with what the wheel holds before all else."""
    path = os.pathsep.join(str(p) for p in (first, installed) if p is not None)
    environment = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    return subprocess.run(
        [sys.executable, *words], cwd=cwd, env=environment, capture_output=True, text=True, check=False, timeout=600
    )


def test_the_wheel_alone_runs_the_demo(installed, tmp_path):
    """Outside the repository: its own files are imported, and the demo writes a result that is loaded again.

    What the bat's demo is held to in ``tests/mocap/test_main_job.py`` holds for this one, of a lizard.
    """
    where = run_there(installed, tmp_path, "-c", "import mocap, eal, filters, datasets; print(mocap.__file__)")
    assert where.stdout.startswith(str(installed)), where.stderr
    shorter = "from functools import partial; from mocap.pipeline import demo; "
    shorter += "demo.run_demo = partial(demo.run_demo, n_frames=240); "
    command = shorter + "from mocap.cli.main import main; main()"
    done = run_there(installed, tmp_path, "-c", command, "demo", "lizard", "--out", "out")
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert_beats_others(report["gaps"])
    assert_intervals_hold(report)
    assert_each_joint_has_a_potential(load(tmp_path / "out").run)
    script = "import mocap; r = mocap.load('out'); print(len(r.joints), r.markers.sizes['keypoint'])"
    loaded = run_there(installed, tmp_path, "-c", script)
    assert loaded.stdout.split() == ["18", "24"], loaded.stderr


def test_wheel_and_sdist_carry_the_licence(installed):
    """The text of ``LICENSE`` in both; the source distribution has all four packages and what they need at run time."""
    text = (ROOT / "LICENSE").read_bytes()
    (licence,) = installed.glob("eal_mocap-*.dist-info/licenses/LICENSE")
    assert licence.read_bytes() == text
    build = "from setuptools.build_meta import build_sdist; build_sdist('../sdist')"
    subprocess.run([sys.executable, "-c", build], cwd=installed.parent / "source", check=True, capture_output=True)
    (archive,) = (installed.parent / "sdist").iterdir()
    with tarfile.open(archive) as files:
        inside = {name.partition("/")[2] for name in files.getnames()}
        (member,) = [m for m in files.getmembers() if m.name.partition("/")[2] == "LICENSE"]
        found = files.extractfile(member)
        assert found is not None
        assert found.read() == text
    wanted = [
        path.relative_to(ROOT) for name in PACKAGES for path in (ROOT / name).rglob("*") if path.suffix in SHIPPED
    ]
    assert not {path.as_posix() for path in wanted} - inside


def test_a_package_of_the_same_name_is_told(installed, tmp_path):
    """Another distribution's ``datasets`` before ours: one line that says which file and what to do."""
    (tmp_path / "other" / "datasets").mkdir(parents=True)
    (tmp_path / "other" / "datasets" / "__init__.py").write_text('"""Somebody else\'s."""\n')
    command = "from mocap.cli.main import main; main()"
    done = run_there(installed, tmp_path, "-c", command, "--help", first=tmp_path / "other")
    assert done.returncode == 1
    assert "the package 'datasets' that Python finds" in done.stderr
    assert "in its own environment" in done.stderr


@pytest.mark.parametrize(
    ("package", "words", "extra"),
    [
        ("jax", ["reproduce", "7"], "mechanics"),
        ("trimesh", ["design-joint", "somewhere"], "joint-design"),
    ],
)
def test_an_absent_extra_is_named(tmp_path, package, words, extra):
    """The commands that need it say in one line how to install it; nothing is written."""
    block = f"import sys; sys.modules[{package!r}] = None\n"
    hide = "import importlib.util as u; f = u.find_spec\n"
    hide += f"u.find_spec = lambda n, *a: None if n == {package!r} else f(n, *a)\n"
    command = f"{block}{hide}from mocap.cli.main import main; main()"
    out = tmp_path / "out"
    done = run_there(ROOT, tmp_path, "-c", command, *words, "--out", str(out))
    assert done.returncode == 1
    assert f"pip install 'eal-mocap[{extra}]'" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not out.exists() or not [p for p in out.iterdir() if not p.name.startswith(".")]


def test_the_main_job_needs_no_extra():
    """What track imports has no package of an extra in it."""
    script = (
        "import sys\n"
        "for name in ('jax', 'trimesh', 'manifold3d', 'networkx', 'lxml', 'av', 'openpyxl', 'pytest', 'sklearn'):\n"
        "    sys.modules[name] = None\n"
        "import mocap, mocap.library.tracked, mocap.library.learning, mocap.rerun.record, mocap.pipeline.demo\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True)
