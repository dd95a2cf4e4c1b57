"""Windows and macOS, by reading: what does not exist there is not used, but where a line says what happens instead."""

import ast
import re
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import pytest

pytestmark = pytest.mark.quick
ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted(
    [path for room in ("mocap", "eal", "filters", "datasets", "docs") for path in (ROOT / room).rglob("*.py")]
    + [ROOT / "make.py"]
)

MODULES = {"fcntl", "grp", "posix", "pty", "pwd", "readline", "resource", "syslog", "termios", "tty"}
"""Of Python's library, on Unix alone (its documentation: "Availability: Unix")."""
WINDOWS_MODULES = {"msvcrt", "winreg", "winsound", "_winapi"}
OF_OS = {
    *("chown", "chroot", "fchdir", "fchmod", "fchown", "fork", "forkpty", "getegid", "geteuid", "getgid", "getgroups"),
    *("getloadavg", "getpgid", "getpgrp", "getpriority", "getsid", "getuid", "initgroups", "killpg", "lchown", "lockf"),
    *(
        "major",
        "mkfifo",
        "mknod",
        "nice",
        "openpty",
        "pipe2",
        "posix_fallocate",
        "pread",
        "pwrite",
        "sched_getaffinity",
    ),
    *("sched_getparam", "sched_getscheduler", "sched_setscheduler"),
    *("sched_setaffinity", "sched_yield", "sendfile", "setpgid", "setpriority", "setsid", "setuid", "statvfs", "sync"),
    *("sysconf", "tcsetpgrp", "uname", "wait", "wait3", "wait4", "waitid", "O_ASYNC", "O_CLOEXEC", "O_DIRECTORY"),
    *("O_NOATIME", "O_NOCTTY", "O_NOFOLLOW", "O_NONBLOCK", "O_PATH", "O_SYNC", "O_TMPFILE", "O_TEMPORARY", "symlink"),
    *("rename", "execv", "execve", "startfile", "memfd_create", "copy_file_range"),
}
"""Functions and flags of ``os`` that one of the systems lacks, or that do something else there (``rename`` fails on
Windows where a file is in the way; ``execv`` leaves the shell there)."""
SIGNALS = {"SIGINT", "SIGTERM", "SIGABRT", "SIGFPE", "SIGILL", "SIGSEGV", "SIGBREAK"}
"""Those that Windows has."""
PLACES = re.compile(r"^/(proc|sys|dev|tmp|etc|usr|var)/")
POPEN = {"preexec_fn", "pass_fds", "start_new_session", "process_group", "umask", "user", "group"}
STARTS = {"fork", "forkserver"}

ALLOWED = {
    ("eal/needs.py", "text without encoding"): "importlib.metadata reads UTF-8, and takes no encoding",
    ("mocap/batches/engine.py", "/sys/"): "what is not there is suppressed",
    ("mocap/batches/engine.py", "os.sysconf"): "behind a question for win32; macOS has SC_PHYS_PAGES",
    ("mocap/documents.py", "os.O_"): "asked with getattr; without O_NOFOLLOW a link is looked for first",
    ("mocap/cli/main.py", "os.execv"): "behind a question for posix: a C locale is one of Unix",
    ("mocap/io/apart.py", "import resource"): "behind a question for win32, which has limits of its own",
    ("mocap/io/apart.py", "/proc/"): "another number is taken where it cannot be read",
    ("mocap/io/manifest.py", "import fcntl"): "behind a question for win32, which locks by msvcrt",
    ("mocap/io/manifest.py", "import msvcrt"): "behind a question for win32",
    ("mocap/io/manifest.py", "os.O_DIRECTORY"): "behind os.supports_dir_fd, which Windows is not in; macOS has it",
    ("mocap/io/manifest.py", "os.O_NOFOLLOW"): "behind os.supports_dir_fd, which Windows is not in; macOS has it",
    ("mocap/io/manifest.py", "os.O_TEMPORARY"): "behind a question for win32, which alone has it",
    ("mocap/io/movement.py", ".rename"): "of a Dataset, not of a file",
    ("mocap/reading/edits.py", "os.O_"): "O_BINARY, asked with getattr",
    ("mocap/rerun/log_video.py", "os.sched_getparam"): "behind a question for what Linux has",
    ("mocap/rerun/log_video.py", "os.sched_getscheduler"): "behind a question for what Linux has",
    ("mocap/rerun/log_video.py", "os.sched_setscheduler"): "behind a question for what Linux has",
    ("mocap/rerun/log_video.py", "/proc/"): "behind a question whether it is there",
    ("mocap/rerun/guardian.py", "start_new_session"): "Popen of Windows ignores it",
    ("mocap/ending.py", "import fcntl"): "a thread does it where there is none, or where it has no F_SETSIG",
    ("mocap/ending.py", "os.O_ASYNC"): "after fcntl.F_SETSIG, which Linux alone has",
    ("mocap/ending.py", "signal.SIGKILL"): "an argument of fcntl.F_SETSIG, which Linux alone has",
    ("mocap/side_by_side.py", "/proc/"): "0 where it cannot be read",
    ("mocap/side_by_side.py", "os.sysconf"): "after /proc was read, which Linux alone has",
    ("mocap/side_by_side.py", "start forkserver"): "behind a question for linux; others spawn",
    ("mocap/side_by_side.py", "os.sched_getaffinity"): "behind hasattr",
    ("mocap/side_by_side.py", "signal.SIG_BLOCK"): "where a forkserver starts, which is on linux alone",
    ("mocap/side_by_side.py", "signal.SIG_SETMASK"): "where a forkserver starts, which is on linux alone",
}
"""What stands in a file though not all systems have it, and why it does no harm there."""


def used(tree: ast.AST) -> list[str]:
    """What a file uses that not all systems have."""
    found: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [f"import {one.name}" for one in node.names if one.name in MODULES | WINDOWS_MODULES]
        elif isinstance(node, ast.ImportFrom) and node.module in MODULES | WINDOWS_MODULES:
            found.append(f"import {node.module}")
        elif isinstance(node, ast.ImportFrom) and node.module == "os":
            found += [f"os.{one.name}" for one in node.names if one.name in OF_OS]
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id == "os" and node.attr in OF_OS:
                found.append(f"os.{node.attr}")
            if node.value.id == "signal" and node.attr.startswith("SIG") and node.attr not in {*SIGNALS, "SIG_IGN"}:
                found.append(f"signal.{node.attr}")
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            place = PLACES.match(node.value)
            found += [f"/{place[1]}/"] if place else []
            found += ["os.O_"] if re.fullmatch(r"O_[A-Z]+", node.value) and f"os.{node.value}" not in found else []
        elif isinstance(node, ast.Call):
            found += called(node)
    return found


def called(node: ast.Call) -> list[str]:
    """Ways to start processes, texts whose encoding the system decides, and links."""
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    given = {one.arg: one.value for one in node.keywords}
    found = [word for word in given if word in POPEN and name in ("run", "Popen", "check_output", "call")]
    first = node.args[0].value if node.args and isinstance(node.args[0], ast.Constant) else None
    if name in ("get_context", "set_start_method") and first in STARTS:
        found.append(f"start {first}")
    if name in ("symlink_to", "hardlink_to", "rename") and isinstance(node.func, ast.Attribute) and not given:
        found += [f".{name}"] if name != "rename" or not isinstance(node.args[0], ast.Dict) else []
    if "encoding" in given:
        return found
    mode = given.get("mode", node.args[1] if len(node.args) > 1 else None)
    binary = isinstance(mode, ast.Constant) and "b" in str(mode.value)
    if name in ("read_text", "write_text") or (isinstance(node.func, ast.Name) and name == "open" and not binary):
        found.append("text without encoding")
    if any(isinstance(given.get(word), ast.Constant) and given[word].value is True for word in ("text",)):
        found.append("text without encoding")
    return found


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("import fcntl", ["import fcntl"]),
        ("os.fork()", ["os.fork"]),
        ("signal.signal(signal.SIGHUP, f)", ["signal.SIGHUP"]),
        ("signal.signal(signal.SIGTERM, f)", []),
        ("get_context('fork')", ["start fork"]),
        ("open(path)", ["text without encoding"]),
        ("open(path, 'rb')", []),
        ("path.read_text(encoding='utf-8')", []),
        ("subprocess.run(words, text=True)", ["text without encoding"]),
        ("Path('/proc/self/statm')", ["/proc/"]),
        ("path.rename(other)", [".rename"]),
        ("data.rename({'a': 'b'})", []),
        ("table.rename(columns=names)", []),
    ],
)
def test_what_some_system_lacks_is_seen(line, found):
    """One line each, and its harmless neighbour."""
    assert used(ast.parse(line)) == found


def test_what_some_system_lacks_is_not_used_without_a_reason():
    """Every use stands in the list with what happens where it does not exist; nothing stands there in vain."""
    found = {
        (path.relative_to(ROOT).as_posix(), what)
        for path in SOURCES
        for what in used(ast.parse(path.read_text(encoding="utf-8")))
    }
    assert found - ALLOWED.keys() == set()
    assert ALLOWED.keys() - found == set()


RESERVED = {"con", "prn", "aux", "nul", *(f"{name}{i}" for name in ("com", "lpt") for i in range(1, 10))}


def in_git() -> list[str]:
    """Names of all files that are committed or staged."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True).stdout
    return listed.decode("utf-8").rstrip("\0").split("\0")


def test_every_system_can_hold_the_files():
    """Windows knows no ``:`` and no ``aux.py``; it and macOS take names that differ in case for one."""
    names = in_git()
    parts = {part for name in names for part in name.split("/")}
    assert not {part for part in parts if re.search(r'[<>:"|?*\\\x00-\x1f]|[. ]$', part)}
    assert not {part for part in parts if part.partition(".")[0].lower() in RESERVED}
    assert not [name for name, count in Counter(name.lower() for name in names).items() if count > 1]
    assert max(map(len, names)) < 180  # of 260, with the folder of a clone before


TOP = {
    *(".ci", ".github", ".gitignore", ".pre-commit-config.yaml", "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md"),
    *("LICENCES.md", "LICENSE", "MANIFEST.in", "Makefile", "README.md", "benchmarks", "datasets", "docs", "eal"),
    *("filters", "make.py", "mocap", "pyproject.toml", "requirements-dev.lock", "requirements-lowest.lock"),
    *("requirements.lock", "tests", "typings"),
}


def test_nothing_strange_lies_at_the_top_nor_anything_large_below():
    """What an experiment leaves, as arrays of a recording, is committed soon, and stays in the history for ever."""
    names = in_git()
    assert {name.split("/")[0] for name in names} == TOP
    assert max((ROOT / name).stat().st_size for name in names if (ROOT / name).exists()) < 1.1e6


@pytest.mark.rare
def test_the_workflow_of_the_three_systems_is_right():
    """By actionlint, where it is installed or Go can run it."""
    tool = [shutil.which("actionlint")] if shutil.which("actionlint") else []
    if not tool and shutil.which("go"):
        tool = ["go", "run", "github.com/rhysd/actionlint/cmd/actionlint@v1.7.7"]
    if not tool:
        pytest.skip("neither actionlint nor Go is installed")
    done = subprocess.run(
        [*map(str, tool), *map(str, (ROOT / ".github" / "workflows").glob("*.yml"))],
        cwd=ROOT,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
        timeout=300,
    )
    if "proxy" in done.stderr or "dial tcp" in done.stderr:
        pytest.skip("Go's proxy does not answer")
    assert done.returncode == 0, done.stdout + done.stderr
