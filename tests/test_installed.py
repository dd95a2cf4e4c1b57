"""What is installed: the wheel alone runs the demo, stands beside other packages, and names extras that are absent."""

import json
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from docs.tools import columns
from mocap import load
from mocap.manual import ROOMS
from tests.mocap.test_library import documented_names

ROOT = Path(__file__).resolve().parents[1]
PACKAGES, SHIPPED = ("mocap", "eal", "filters", "datasets"), (".py", ".toml", ".html", ".typed")


OTHERS = ("deeplabcut>=3", "movement", "sleap-io", "napari")


@pytest.fixture(scope="module")
def beside(tmp_path_factory):
    """What a package index says of one environment with all of them and us, asked while the other tests go on."""
    wanted = tmp_path_factory.mktemp("beside") / "others.in"
    wanted.write_text("\n".join(OTHERS) + "\n")
    uv = [sys.executable, "-m", "uv", "pip", "compile", "--no-header", "--no-annotate", "--python-version", "3.12"]
    with ThreadPoolExecutor() as pool:
        yield pool.submit(from_the_index, [*uv, "--all-extras", ROOT / "pyproject.toml", wanted], "No solution found")


def from_the_index(command: list, but: str = "\0") -> subprocess.CompletedProcess[str]:
    """Run what asks a package index: the one that pip is told of.

    Where none answers the test is skipped, in continuous integration it fails, and everywhere with the words ``but``.
    """
    told = subprocess.run(
        [sys.executable, "-m", "pip", "config", "get", "global.index-url"], capture_output=True, text=True, check=False
    )
    index = os.environ.get("PIP_INDEX_URL") or told.stdout.strip()
    variables = os.environ | ({"UV_DEFAULT_INDEX": index} if index else {})
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=500, env=variables)
    if done.returncode != 0 and but not in done.stderr and not os.environ.get("CI"):
        pytest.skip(f"no package index answers here: {done.stderr.strip().splitlines()[-1:]}")
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="module")
def installed(tmp_path_factory, beside):  # noqa: ARG001
    """The wheel, built from a copy of the sources and unpacked into a folder of its own."""
    folder = tmp_path_factory.mktemp("wheel")
    wheels, target = folder / "wheels", folder / "site"
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in tracked.splitlines():
        if name.startswith(("tests/", "benchmarks/", "docs/experiments/")) or not (ROOT / name).is_file():
            continue
        (folder / "source" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "source" / name).write_bytes((ROOT / name).read_bytes())
    zipfile.ZipFile(built("wheel", folder / "source", wheels)).extractall(target)
    return target


def built(kind: str, source: Path, folder: Path) -> Path:
    """A wheel, an editable one or a source distribution, as its builder makes it, without pip's own work."""
    folder.mkdir()
    command = f"import sys, setuptools.build_meta as b; b.build_{kind}(sys.argv[1])"
    subprocess.run([sys.executable, "-c", command, folder], cwd=source, check=True, capture_output=True)
    (made,) = folder.iterdir()
    return made


@pytest.fixture(scope="module")
def sdist(installed):
    """The source distribution, built from the same copy."""
    return built("sdist", installed.parent / "source", installed.parent / "sdist")


def run_there(installed: Path, cwd: Path, *words: str, last: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Python outside the repository, with what the wheel holds before all else."""
    path = os.pathsep.join(str(p) for p in (installed, last) if p is not None)
    environment = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    return subprocess.run(
        [sys.executable, *words], cwd=cwd, env=environment, capture_output=True, text=True, check=False, timeout=600
    )


DEMO = """
from functools import partial
from itertools import islice

import datasets, eal, mocap, mocap.datasets, mocap.filters
from mocap.cli.main import main
from mocap.report import demo
from mocap.plots import figures

demo.run_demo, pictures = partial(demo.run_demo, n_frames=100), figures.pictures
figures.pictures = lambda *run: islice(pictures(*run), 1)
try:
    main()
except SystemExit as stopped:
    assert not stopped.code
result = mocap.load("out")
print()
print(mocap.__file__, datasets.OWNER, len(result.joints), result.markers.sizes["keypoint"])
"""
"""A part of a bat's flight, and one figure: with that the other modules and files of the wheel are at hand, too."""


@pytest.fixture(scope="module")
def ran(installed, tmp_path_factory):
    """The folder that the demo of the wheel alone writes, outside the repository, and what the process says of it.

    Where it runs, another distribution has a package ``datasets``, as Hugging Face's is in most environments.
    """
    folder, other = tmp_path_factory.mktemp("demo"), tmp_path_factory.mktemp("other")
    (other / "datasets").mkdir()
    (other / "datasets" / "__init__.py").write_text("OWNER = 'somebody-else'\n")
    done = run_there(installed, folder, "-c", DEMO, "demo", "bat", "--out", "out", last=other)
    assert done.returncode == 0, done.stderr
    return folder / "out", done.stdout.splitlines()


@pytest.fixture(scope="module")
def demo(ran):
    """The folder."""
    return ran[0]


@pytest.fixture(scope="module")
def result(demo):
    """What is in it."""
    return load(demo)


def test_the_wheel_alone_runs_the_demo(installed, ran, result):
    """Its own files are imported, another's ``datasets`` is left alone, and it writes a result that it loads again."""
    *said, last = ran[1]
    where, owner, *counts = last.split()
    assert where == str(installed / "mocap" / "__init__.py")
    assert owner == "somebody-else"
    assert counts == [str(len(result.skeleton.joints)), str(len(result.skeleton.markers))]
    (following,) = [line for line in said if line.startswith("Next, with your own files: ")]
    assert " info FILES " in following


def test_the_demo_beats_what_people_use(demo):
    """Inside the recording's own gaps the EAL tracker is nearer to the truth than all of them."""
    gaps = json.loads((demo / "report.json").read_text())["gaps"]
    honest = ("conditional_gaussian", "principal_components")
    assert set(gaps) == {"mixture", "constant_velocity", "cubic", "linear", "chains", *honest}
    assert gaps["cubic"]["coverage95"] is None
    assert gaps["mixture"]["rmse_mm"] < min(gap["rmse_mm"] for name, gap in gaps.items() if name != "mixture")
    assert max(gaps[name]["rmse_mm"] for name in honest) < gaps["linear"]["rmse_mm"]


def test_the_demo_knows_how_well_it_knows(demo):
    """95 % intervals hold 90 % of the truth or more, where markers are seen at most 99.5 %; a track beats its points.

    In gaps they may hold all: those of this recording are easier than those that it hides from itself.
    """
    report = json.loads((demo / "report.json").read_text())
    measured = report["measured"]
    assert report["gaps"]["mixture"]["coverage95"] >= 90
    assert 90 <= measured["mixture"]["coverage95"] <= 99.5
    assert measured["mixture"]["rmse_mm"] < measured["triangulation"]["rmse_mm"]


def test_every_quantity_of_the_demo_is_documented(demo, result):
    """Joints with stated axes, strokes, spans, areas and centres of mass among them."""
    report = json.loads((demo / "report.json").read_text())
    assert not columns.undocumented(result.kinematics, "kinematics.csv", documented_names(result))
    assert not columns.undocumented(result.cycles.columns, "cycles.csv", {})
    assert not columns.undocumented(report, "report.json", {})


def test_the_demo_learns_a_potential_for_each_joint(result):
    """V_z is near 0 on the joint's samples and 1 at three times their extent; every joint of the skeleton has one."""
    assert set(result.potentials) == {j.name for j in result.skeleton.joints}
    for potential in result.potentials.values():
        q = potential.samples_m / potential.scale_m
        far = q.mean(axis=0) + 3 * np.ptp(q, axis=0)
        assert np.median(potential.potential.value(q)) < 0.05
        assert potential.potential.value(far) > 0.99


def test_wheel_and_sdist_carry_the_licence(installed, sdist):
    """The text of ``LICENSE`` in both; the source distribution has all four packages and what they need at run time."""
    text = (ROOT / "LICENSE").read_bytes()
    (licence,) = installed.glob("eal_mocap-*.dist-info/licenses/LICENSE")
    assert licence.read_bytes() == text
    with tarfile.open(sdist) as files:
        inside = {name.partition("/")[2] for name in files.getnames()}
        (member,) = [m for m in files.getmembers() if m.name.partition("/")[2] == "LICENSE"]
        found = files.extractfile(member)
        assert found is not None
        assert found.read() == text
    wanted = [
        path.relative_to(ROOT) for name in PACKAGES for path in (ROOT / name).rglob("*") if path.suffix in SHIPPED
    ]
    assert not {path.as_posix() for path in wanted} - inside


def test_the_wheel_has_two_names_of_its_own(installed):
    """``mocap`` and ``eal``: no other distribution's folder is written to; every folder of sources is in the list."""
    found = {path.name for path in installed.iterdir() if path.name != "bin" and path.suffix != ".dist-info"}
    assert found == {"mocap", "eal"}
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"]
    folders = {path.parent.relative_to(ROOT) for name in PACKAGES for path in (ROOT / name).rglob("*.py")}
    names = {".".join(folder.parts) for folder in folders}
    pages = {"mocap.pages." + room.replace("/", ".") for room in ROOMS}
    assert set(stated) - pages == {f"mocap.{n}" if n.startswith(("filters", "datasets")) else n for n in names}
    assert (installed / "mocap" / "pages" / "howto" / "your_files.md").is_file()
    assert (installed / "mocap" / "py.typed").is_file()
    assert (installed / "eal" / "py.typed").is_file()


def test_the_sdist_gives_the_same_wheel_and_an_editable_one_the_same_modules(installed, sdist, tmp_path):
    """As a packager of another system has it, and who develops with it from a folder elsewhere, with its resources."""
    folder = installed.parent
    with tarfile.open(sdist) as files:
        files.extractall(tmp_path / "unpacked", filter="data")
    (unpacked,) = (tmp_path / "unpacked").iterdir()
    (wheel,), again = (folder / "wheels").iterdir(), built("wheel", unpacked, tmp_path / "again")
    with zipfile.ZipFile(wheel) as one, zipfile.ZipFile(again) as other:
        assert {e.filename: e.CRC for e in one.infolist()} == {e.filename: e.CRC for e in other.infolist()}
    editable = built("editable", folder / "source", tmp_path / "editable")
    zipfile.ZipFile(editable).extractall(tmp_path / "env")
    script = (
        "import site, sys; site.addsitedir(sys.argv[1])\n"
        "from importlib.resources import files; import mocap; from importlib.util import find_spec as find\n"
        "print(find('mocap.filters').origin, find('mocap.datasets').origin, files('mocap').joinpath('py.typed'))"
    )
    command = [sys.executable, "-S", "-c", script, tmp_path / "env"]  # without the packages of this environment
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    source = folder / "source"
    wanted = [source / "filters" / "__init__.py", source / "datasets" / "__init__.py", source / "mocap" / "py.typed"]
    assert done.stdout.split() == [str(place) for place in wanted]


CONDA = {"opencv-python-headless": "py-opencv", "matplotlib": "matplotlib-base"}
"""Names of packages that conda-forge has otherwise."""


RENDERED = """
import json, sys
from pathlib import Path
from rattler_build import Stage0Recipe
(variant,) = Stage0Recipe.from_file(Path(sys.argv[1])).render()
print(json.dumps(variant.recipe.to_dict()))
"""


def wanted_of_conda() -> set[str]:
    """Packages of the main job and their bounds, as conda-forge names them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = {f"python {project['requires-python']}"}
    for line in project["dependencies"]:
        name, *bounds = re.split(r"(?=[<>=])", line, maxsplit=1)
        wanted.add(" ".join((CONDA.get(name, name), *bounds)))
    return wanted


def test_the_conda_recipe_asks_for_what_the_wheel_asks_for():
    """The packages of the main job and their bounds, and the commands."""
    recipe = (ROOT / "docs" / "releasing" / "recipe.yaml").read_text(encoding="utf-8")
    (needed,) = re.findall(r"  run:\n((?:    - .*\n)+)", recipe)
    (python_min,) = re.findall(r'python_min: "(.*)"', recipe)
    assert set(re.findall(r"- (.*)", needed.replace("${{ python_min }}", python_min))) == wanted_of_conda()
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]
    assert re.findall(r"- (\S+) = (\S+:\S+)", recipe) == list(scripts.items())


def test_rattler_build_renders_the_recipe():
    """conda-forge's builder reads it, and its requirements are the wheel's; the tool is asked from the index."""
    pytest.importorskip("uv", reason="a tool of the locked environment")
    place = ROOT / "docs" / "releasing" / "recipe.yaml"
    tool = ["--no-project", "--with", "py-rattler-build>=0.60"]
    found = from_the_index([sys.executable, "-m", "uv", "run", "--quiet", *tool, "python", "-c", RENDERED, place])
    rendered = json.loads(found.stdout)
    assert set(rendered["requirements"]["run"]) == wanted_of_conda()
    assert rendered["package"]["name"] == "eal-mocap"


@pytest.mark.rare
@pytest.mark.parametrize("runner", [["--from"], ["pipx", "run", "--spec"]])
def test_uvx_and_pipx_run_the_wheel(installed, runner, tmp_path, monkeypatch):
    """As the page on installing types them: the version, the help, and what to do next in words that run again."""
    pytest.importorskip("uv", reason="a tool of the locked environment")
    for name in ("PIPX_HOME", "PIPX_BIN_DIR", "UV_TOOL_DIR"):
        monkeypatch.setenv(name, str(tmp_path / "pipx" / ".cache"))
    (wheel,) = (installed.parent / "wheels").iterdir()
    run = [sys.executable, "-m", "uv", "tool", "run", *runner, wheel, "mocap"]
    page = (ROOT / "docs" / "howto" / "installing.md").read_text(encoding="utf-8")
    assert "uvx --from . mocap" in page
    assert "pipx run --spec . mocap" in page
    assert from_the_index([*run, "--version"]).stdout.startswith("mocap 1.")
    assert "Usage: mocap" in from_the_index([*run, "--help"]).stdout
    again = "uvx eal-mocap" if runner == ["--from"] else "pipx run eal-mocap"
    assert f"{again} demo bat" in from_the_index(run).stdout


def test_it_can_stand_beside_the_other_programs_of_the_field(beside):
    """One environment can hold all of them and us, with all our extras; only resolved, not installed."""
    pytest.importorskip("uv", reason="a tool of the locked environment")
    versions = dict(line.partition(" ")[0].split("==") for line in beside.result().stdout.splitlines() if "==" in line)
    assert {"deeplabcut", "movement", "sleap-io", "napari", "rerun-sdk", "pandas"} <= versions.keys()
    assert versions["deeplabcut"].startswith("3.")


def test_folders_of_the_repository_are_the_installed_modules():
    """At its root ``import filters`` gives the modules of ``mocap.filters``, submodules and classes included."""
    script = (
        "import filters, filters.models.base, datasets.rig, mocap.filters, mocap.datasets, mocap.datasets.rig as rig\n"
        "from filters.track import smooth\n"
        "from mocap.filters.track import smooth as same\n"
        "import mocap.filters.models.base as base\n"
        "assert filters is mocap.filters and datasets is mocap.datasets and smooth is same\n"
        "assert filters.models.base is base and datasets.rig is rig and base.__spec__.name == base.__name__\n"
    )
    subprocess.run([sys.executable, "-c", script], cwd=ROOT, check=True)


def test_importing_mocap_imports_nothing_else():
    """Neither rooms of ours nor libraries: names are imported when they are first used."""
    script = "import sys; import mocap; print([m for m in sys.modules if m.startswith(('mocap.', 'eal', 'numpy'))])"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "[]"


ABSENT = {
    "trimesh": ("joint-design", ["design-joint", "somewhere"]),
    "starlette": ("web", ["digitise", "films", "--calibration", "c", "--skeleton", "s", "--web"]),
}
"""Packages, the extras that have them, and commands that need them."""
OF_EXTRAS = ("jax", "manifold3d", "networkx", "lxml", "av", "openpyxl", "uvicorn", "pytest", "sklearn")
"""Others that the main job must not import."""


def test_the_main_job_needs_no_extra_and_an_absent_one_is_named(tmp_path):
    """What track imports has no package of an extra in it. Commands that need one say in one line how to install it.

    Nothing is written.
    """
    commands = [["mocap", *words, "--out", str(tmp_path / "out")] for _, words in ABSENT.values()]
    script = (
        "import importlib.util as u, sys\n"
        f"absent, find = {[*ABSENT, *OF_EXTRAS]}, u.find_spec\n"
        "sys.modules.update(dict.fromkeys(absent))\n"
        "import mocap, mocap.results.tracked, mocap.tracking.learning, mocap.rerun.record, mocap.report.demo\n"
        "u.find_spec = lambda n, *a: None if n in absent else find(n, *a)\n"
        "from mocap.cli.main import main\n"
        f"for sys.argv in {commands}:\n"
        "    try:\n"
        "        main()\n"
        "    except SystemExit as stopped:\n"
        "        assert stopped.code == 1\n"
    )
    done = run_there(ROOT, tmp_path, "-c", script)
    assert done.returncode == 0, done.stderr
    for line, (extra, _) in zip(done.stderr.strip().splitlines(), ABSENT.values(), strict=True):
        assert re.search(rf"pip install (--editable )?'.*\[{extra}\]'", line)
    assert not [p for p in tmp_path.rglob("*") if not p.name.startswith(".")]
