"""Build a release and try it: ``make release``, on the tag that is checked out.

    python -m docs.releasing.release [--rehearse] [--python 3.12]... [--out dist]

Builds wheel and source distribution from the commit, not from the folder, installs each in a fresh environment of each
Python, and runs it there. Asks a package index whether it can stand beside other programs of the field. Writes the
recipe for conda-forge with the checksum. Uploads nothing.
"""

import argparse
import hashlib
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PYTHONS = "3.11", "3.12", "3.13"
BESIDE = ("movement", "sleap-io", "deeplabcut>=3")
TRIED = (
    ("python", "-c", "import eal, mocap, mocap.filters, mocap.datasets"),
    ("eal-mocap", "--version"),
    ("mocap", "data", "make", "bat", "--out", "bat"),
    ("mocap", "info", "bat/bat_xypts.csv", "--fps", "700"),
)
"""What is run of the source distribution, too; of the wheel the demo besides, whose result is then loaded."""
DEMO = (("mocap", "demo", "bat", "--out", "demo"), ("mocap", "kinematics", "demo"))


class Unready(Exception):
    """The tree is not what can be released."""


def words(*command: str | Path, cwd: Path = ROOT) -> str:
    """What a program says; an error ends the release with its last lines."""
    done = subprocess.run(
        [str(word) for word in command], cwd=cwd, capture_output=True, text=True, encoding="utf-8", check=False
    )
    if done.returncode:
        last = "\n".join([*done.stdout.splitlines(), *done.stderr.splitlines()][-25:])
        raise Unready(f"{' '.join(map(str, command))}: code {done.returncode}\n{last}")
    return done.stdout


def version() -> str:
    """Of ``pyproject.toml``."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]


def unready(release: str) -> list[str]:
    """What is missing before a version can be released: tag, clean tree, changelog, version in all places."""
    found = []
    if f"v{release}" not in words("git", "tag", "--points-at", "HEAD").split():
        found.append(f"the commit has no tag v{release}: git tag -a v{release}")
    if words("git", "status", "--porcelain"):
        found.append("the folder has changes that are not committed")
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.search(r"^## (\S+)", changes, re.MULTILINE)
    if newest is None or newest[1] != release:
        found.append(f"CHANGELOG.md does not begin with {release}")
    if f"version: {release}\n" not in (ROOT / "CITATION.cff").read_text(encoding="utf-8"):
        found.append(f"CITATION.cff has not version {release}")
    if f'version: "{release}"' not in (ROOT / "docs/releasing/recipe.yaml").read_text(encoding="utf-8"):
        found.append(f"docs/releasing/recipe.yaml has not version {release}")
    return found


def build(out: Path) -> list[Path]:
    """Wheel and source distribution of the commit, the wheel built from the source distribution."""
    with tempfile.TemporaryDirectory() as place:
        archive = Path(place) / "source.tar"
        words("git", "archive", "--output", archive, "HEAD")
        with tarfile.open(archive) as files:
            files.extractall(Path(place) / "source", filter="data")
        uv("build", "--out-dir", out, cwd=Path(place) / "source")
    return sorted([*out.glob("*.whl"), *out.glob("*.tar.gz")])


def uv(*command: str | Path, cwd: Path = ROOT) -> str:
    """What uv says."""
    return words(sys.executable, "-m", "uv", *command, cwd=cwd)


def ask_the_index_of_pip() -> None:
    """Tell uv, which does not read pip's configuration, of the index there."""
    configured = [sys.executable, "-m", "pip", "config", "get", "global.index-url"]
    done = subprocess.run(configured, capture_output=True, text=True, encoding="utf-8", check=False)
    index = os.environ.get("PIP_INDEX_URL") or done.stdout.strip()
    if index:
        os.environ.setdefault("UV_DEFAULT_INDEX", index)


def tried(distribution: Path, python: str) -> None:
    """Install one file in a fresh environment and run it in an empty folder."""
    with tempfile.TemporaryDirectory() as place:
        environment = Path(place) / "venv"
        uv("venv", "--quiet", "--python", python, environment)
        there = environment / ("Scripts" if os.name == "nt" else "bin")
        uv("pip", "install", "--quiet", "--python", environment, distribution)
        for program, *rest in (*TRIED, *DEMO) if distribution.suffix == ".whl" else TRIED:
            words(there / program, *rest, cwd=Path(place))


def recipe(sdist: Path, out: Path) -> Path:
    """The recipe for conda-forge with the checksum of the source distribution."""
    text = (ROOT / "docs/releasing/recipe.yaml").read_text(encoding="utf-8")
    path = out / "recipe.yaml"
    checksum = hashlib.sha256(sdist.read_bytes()).hexdigest()
    path.write_text(re.sub(r'sha256: "0+"', f'sha256: "{checksum}"', text), encoding="utf-8")
    return path


def main() -> None:
    """Build, try, and say what to upload."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rehearse", action="store_true", help="also where tag, changelog or tree are not ready")
    parser.add_argument(
        "--python", action="append", help=f"Python to try; several times. Default: {', '.join(PYTHONS)}"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "dist")
    given = parser.parse_args()
    release, out = version(), given.out.resolve()
    ask_the_index_of_pip()
    try:
        if missing := unready(release):
            print("\n".join(f"not ready: {one}" for one in missing), file=sys.stderr)
            if not given.rehearse:
                sys.exit(1)
        if out.exists() and any(out.glob("*.whl")):
            raise Unready(f"{out} holds a wheel: remove it")
        made = build(out)
        print("built:", ", ".join(f"{path.name} ({path.stat().st_size / 1e6:.1f} MB)" for path in made), flush=True)
        for python in given.python or PYTHONS:
            for path in made:
                tried(path, python)
                print(f"Python {python}: {path.name} installs and runs", flush=True)
        with tempfile.TemporaryDirectory() as place:
            wanted = Path(place) / "beside.in"
            wanted.write_text(
                "\n".join([*BESIDE, str(next(p for p in made if p.suffix == ".whl"))]) + "\n", encoding="utf-8"
            )
            uv("pip", "compile", "--quiet", "--python-version", "3.12", wanted)
        print(f"one environment can hold it beside {', '.join(BESIDE)}", flush=True)
        recipe(next(p for p in made if p.name.endswith(".tar.gz")), out)
    except Unready as error:
        sys.exit(f"error: {error}")
    print(f"Ready: upload {', '.join(p.name for p in made)}; send {out.name}/recipe.yaml to the feedstock.")


if __name__ == "__main__":
    main()
