"""What ``make`` does, also where there is no make: ``python make.py demo``, or ``python -m make demo``.

Needs Python alone. Everything is installed into ``.venv``, once; a lock file that changed is installed again.
"""

import os
import queue
import re
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent
BIN = "Scripts" if os.name == "nt" else "bin"
OLDEST = (3, 11)
SIZES = {"requirements.lock": "1.3 GB", "requirements-dev.lock": "another 1.4 GB", "requirements-lowest.lock": "2.7 GB"}
"""Of what a lock file installs, on disk."""


def python(folder=".venv"):
    """The interpreter of an environment."""
    return ROOT / folder / BIN / ("python.exe" if os.name == "nt" else "python")


def run(*words, **variables):
    """Run a program here; where it fails, end as it did."""
    shown = [str(word) for word in words]
    code = subprocess.run(shown, cwd=ROOT, env={**os.environ, **variables}, check=False).returncode
    if code:
        sys.exit(code if code > 0 else 1)


def module(name, *words, folder=".venv", **variables):
    """Run a module with the interpreter of an environment."""
    run(python(folder), "-m", name, *words, **variables)


def install(lock, stamp, folder=".venv", *, editable=False):
    """Install what a lock file has, and us, unless that was done; say how far it is."""
    done = ROOT / folder / stamp
    sources = [ROOT / lock, ROOT / "pyproject.toml"]
    if done.exists() and done.stat().st_mtime >= max(path.stat().st_mtime for path in sources):
        return
    if not python(folder).exists():
        print(f"Making the environment {folder}", flush=True)
        run(sys.executable, "-m", "venv", folder)
    print(f"Installing packages ({SIZES[lock]}) into {folder}; some minutes, once.", flush=True)
    pip = [python(folder), "-m", "pip", "install", "--disable-pip-version-check"]
    counted([*pip, "--progress-bar", "off", "--require-hashes", "-r", lock], total=packages(ROOT / lock))
    if editable:
        run(*pip, "--quiet", "--no-deps", "--no-build-isolation", "--editable", ".")
    done.touch()


def packages(lock):
    """How many a lock file has, those of other systems included."""
    return len(re.findall(r"^[\w.-]+==", lock.read_text(encoding="utf-8"), re.MULTILINE))


class Installed:
    """How far pip is, by the lines that it prints."""

    def __init__(self, total):
        """Nothing is installed of ``total`` packages."""
        self.total, self.collected, self.loaded_mb, self.unpacking = total, 0, 0.0, False

    def __call__(self, line):
        """Take a line of pip's into account."""
        self.collected += line.startswith("Collecting ")
        self.unpacking |= line.startswith("Installing collected packages")
        size = re.search(r"Downloading .*\(([\d.]+) (kB|MB)\)", line)
        if size:
            self.loaded_mb += float(size[1]) / (1000 if size[2] == "kB" else 1)

    def __str__(self):
        """In a few words."""
        loaded = f", {self.loaded_mb:.0f} MB downloaded" if self.loaded_mb else ""
        if self.unpacking:
            return f"unpacking {self.collected} packages{loaded}"
        return f"{self.collected} packages of about {self.total}{loaded}"


def counted(command, *, total, every_s=10.0):
    """Run pip and say how far it is: on a terminal in one line, else now and then; its last lines where it fails."""
    started = said = time.monotonic()
    process = subprocess.Popen(
        [str(word) for word in command],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
    )
    lines, shown, last = queue.Queue(), Installed(total), []
    reader = threading.Thread(target=lambda: [lines.put(line) for line in process.stdout] + [lines.put(None)])
    reader.start()
    terminal, ended = sys.stdout.isatty(), False
    while not ended:
        try:
            line = lines.get(timeout=0.5)
            ended = line is None
            if line:
                shown(line)
                last = [*last[-19:], line]
        except queue.Empty:
            pass
        now = time.monotonic()
        if terminal:
            print(f"\r  {shown}, {now - started:.0f} s ", end="", flush=True)
        elif now - said >= every_s:
            said = now
            print(f"  {shown}, {now - started:.0f} s", flush=True)
    print("\r\033[K" if terminal else "", end="")
    reader.join()
    process.stdout.close()
    if process.wait():
        sys.exit("".join(last))


def setup_to_run():
    """What the main job needs, and no more."""
    install("requirements.lock", ".installed-to-run", editable=True)


def setup():
    """All extras, and the tools of tests and checks."""
    setup_to_run()
    install("requirements-dev.lock", ".installed")


def demo():
    """Does it run? The built-in bat, tracked, compared with its ground truth."""
    setup_to_run()
    print("Tracking the built-in bat (1 to 3 minutes).", flush=True)
    run(python().with_name("mocap.exe" if os.name == "nt" else "mocap"), "demo", "bat", "--out", "out/demo", "--force")


def pytest(*words, folder=".venv"):
    """Tests, four at a time at most."""
    module("pytest", "--numprocesses", "auto", "--maxprocesses", "4", *words, folder=folder, OMP_NUM_THREADS="1")


def test():
    """Is it right? All tests but those that take long and rarely fail."""
    setup()
    pytest("-m", "not rare")


def test_rare():
    """Those that take long and rarely fail."""
    setup()
    pytest("-m", "rare")


def test_all():
    """All tests."""
    test()
    test_rare()


def quick():
    """Those tests that take little time."""
    setup()
    pytest("-m", "not slow")


def test_lowest():
    """Those of ``quick`` with the oldest versions that pyproject.toml admits.

    Without views (rerun has one version) and the site, which is built with the locked ones; what the oldest versions
    say of each other's age is not ours to mend.
    """
    folder = ".venv-lowest"
    install("requirements-lowest.lock", ".installed", folder, editable=True)
    left_out = "--ignore=tests/mocap/rerun", "--ignore=tests/test_docs.py"
    pytest("-m", "not slow", "-W", "ignore::DeprecationWarning", "tests", *left_out, folder=folder)


def lint():
    """Style and types."""
    setup()
    for words in (("ruff", "check", "."), ("ruff", "format", "--check", "."), ("pyright",)):
        module(*words)


def check():
    """What continuous integration runs: tests, style and types."""
    test()
    lint()


def bench():
    """The benchmarks that take minutes."""
    setup()
    for name in ("tracker_speed", "main_job", "importers", "attack"):
        module(f"benchmarks.{name}")


def pictures():
    """Pictures of the viewer and the desk for the pages."""
    setup()
    for name in ("view_pictures", "desk_pictures"):
        module(f"docs.tools.{name}", "docs/pictures")


def licences():
    """The page of licences."""
    setup()
    module("docs.tools.licences")


def docs():
    """The site, in build/docs."""
    setup()
    run(python(), "docs/build.py", "build/docs", OMP_NUM_THREADS="1")


def release():
    """Wheel and sdist of the tag that is checked out, in dist/, both tried in fresh environments."""
    setup()
    module("docs.releasing.release")


def lock():
    """The three lock files."""
    setup()
    common = "pip", "compile", "--universal", "--python-version", "3.11", "--generate-hashes"
    common = *common, "--no-emit-index-url", "--no-emit-find-links", "pyproject.toml", "-o"
    module("uv", *common, "requirements.lock", "--group", "build")
    extras = "--all-extras", "--group"
    module("uv", *common, "requirements-dev.lock", *extras, "dev", "--constraint", "requirements.lock")
    module("uv", *common, "requirements-lowest.lock", *extras, "test", "--resolution", "lowest-direct")


def clean():
    """Remove all that this file made."""
    for pattern in (
        ".venv",
        ".venv-lowest",
        ".venv-anipose",
        "out",
        "build",
        "dist",
        "*.egg-info",
        ".pytest_cache",
        ".ruff_cache",
    ):
        for path in ROOT.glob(pattern):
            shutil.rmtree(path)


TARGETS = {
    one.__name__.replace("_", "-"): one
    for one in (
        setup,
        demo,
        test,
        test_rare,
        test_all,
        quick,
        test_lowest,
        check,
        lint,
        bench,
        pictures,
        docs,
        release,
        licences,
        lock,
        clean,
    )
}


def main():
    """The targets that are named, in order."""
    if sys.version_info < OLDEST:
        sys.exit(f"Python 3.11 or newer is needed, this is {sys.version.split()[0]}: make PYTHON=python3.12 ...")
    unknown = [name for name in sys.argv[1:] if name not in TARGETS]
    if unknown or not sys.argv[1:]:
        about = (f"  {name:12} {one.__doc__.splitlines()[0]}" for name, one in TARGETS.items())
        sys.exit("\n".join([f"{unknown[0]}: there is no such target" if unknown else "python make.py TARGET", *about]))
    for name in sys.argv[1:]:
        TARGETS[name]()


if __name__ == "__main__":
    main()
