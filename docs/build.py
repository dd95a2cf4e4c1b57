"""Build the site: ``python docs/build.py OUT [--keep]``; pages in ``OUT/html``, nothing is written beside the sources.

Pages are copied to ``OUT/source``, where the reference made from code joins them; tutorials and gallery run in
``OUT/work`` on the built-in recordings. Warnings are errors, and so are links that lead nowhere and anything that a
browser would have to fetch from another host. ``--keep`` shows again what an earlier build ran, for work on the texts.
"""

import argparse
import os
import shutil
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
DEMO = "mocap demo bat --out out/demo"
"""The run that tutorials, gallery and reference look at."""
MARK = ".eal-mocap-site"
"""In a folder with this file ``source``, ``work``, ``trees`` and ``html`` are ours to replace."""


SECONDS = {"reference": 18.0, "demo": 70.0, "share": 5.0, "scripts": 40.0, "pages": 20.0, "html": 5.0}
"""Processor time of each stage, by whose ratios the time that is left is told; the first two were measured."""


def build(out: Path, *, keep: bool = False, tell: Callable[[str, float], None] = lambda _stage, _share: None) -> int:
    """Build into a folder; 0, or 1 where something is wrong.

    Args:
        out: The folder.
        keep: Whether to show again what an earlier build ran.
        tell: Told of each stage (``SECONDS``) and the share of it that is done.
    """
    from sphinx.cmd.build import main as sphinx

    from docs.tools import html, shell
    from docs.tools.made import PAGES

    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    os.environ.setdefault("MPLBACKEND", "agg")
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    source, work = out / "source", out / "work"
    if out.exists() and any(out.iterdir()) and not (out / MARK).is_file():
        print(f"{out} holds files that no build wrote: give a folder that is new or empty", file=sys.stderr)  # noqa: T201
        return 1
    for name in () if keep else ("source", "work", "trees", "html"):
        shutil.rmtree(out / name, ignore_errors=True)
    out.mkdir(parents=True, exist_ok=True)
    (out / MARK).touch()
    shutil.copytree(ROOT / "docs", source, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
    work.mkdir(parents=True, exist_ok=True)
    for folder in ("tutorials", "gallery"):
        link = source / "scripts" / folder / "out"
        if not link.is_symlink():
            link.symlink_to(work / "out", target_is_directory=True)
    for k, (name, page) in enumerate(PAGES.items()):
        (source / name).write_text(page(), encoding="utf-8")
        tell("reference", (k + 1) / len(PAGES))
    shell.run(DEMO, work)
    tell("demo", 1.0)
    shell.run(f"mocap share out/demo --out {source / 'extra' / 'recordings' / 'bat'} --force", work)
    tell("share", 1.0)
    options = ["-W", "--keep-going", "-q", "-b", "html", "-d", str(out / "trees")]
    options += ["-D", f"version={version}", "-D", f"release={version}", "-D", f"html_title=eal-mocap {version}"]
    shell.TOLD.append(tell)
    failed = sphinx([*options, str(source), str(out / "html")])
    wrong = [] if failed else html.troubles(out / "html")
    for line in wrong:
        print(line, file=sys.stderr)  # noqa: T201
    if not failed and not wrong:
        print(f"the site is in {out / 'html' / 'index.html'}")  # noqa: T201
    return int(bool(failed or wrong))


if __name__ == "__main__":
    given = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    given.add_argument("out", type=Path, metavar="OUT")
    given.add_argument("--keep", action="store_true")
    told = given.parse_args()
    from mocap.cli.console import progress, say
    from mocap.progress import as_one

    say(f"The site takes about {sum(SECONDS.values()) / 60:.0f} minutes of an idle processor.")
    with progress() as shown:
        code = build(told.out.resolve(), keep=told.keep, tell=as_one(shown, "build the site", SECONDS))
    sys.exit(code)
