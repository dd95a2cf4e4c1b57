"""What the pages say is so: commands and options exist, links lead somewhere, the README is short."""

import ast
import json
import platform
import re
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from mocap.filters.anatomy import Anatomy
from mocap.filters.models.base import TrialSet, estimate
from mocap.filters.models.registry import NAMED
from mocap.filters.observations import PositionObservations
from mocap.filters.poses import MarkerTrial

from docs.paper import numbers
from docs.tools import columns, commands, html, licences
from docs.tools.made import PAGES
from eal import fit_potential
from mocap.cli.table import ENTRIES
from mocap.errors import FormatError, MocapError
from mocap.findings import Harm, Kind
from mocap.io.format import Hints, head
from mocap.io.registry import read_as
from mocap.manual import ROOMS, SYMPTOMS, topics, what_to_do
from mocap.trouble import INSTALLING

ROOT = Path(__file__).resolve().parents[1]
TEXTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "docs" / "scripts").rglob("*.py")])
NAMES = [path.relative_to(ROOT).as_posix() for path in TEXTS]
README_LINES = 100
WORDS = 25_000
"""Of the pages a user may read: not measurements (``docs/experiments/``), the paper, and what a release needs."""


def typed(text: str) -> list[str]:
    """Every command of ours in a text: lines of blocks of code, lines that are indented, and code within a line."""
    blocks = re.findall(r"^```.*?^```", text, re.MULTILINE | re.DOTALL)
    lines = re.findall(r"^(mocap [a-z-].*)$", "\n".join(blocks), re.MULTILINE)
    lines += re.findall(r"^(?:#\s*)?    (mocap [a-z-].*)$", text, re.MULTILINE)
    return lines + re.findall(r"`(mocap [a-z][^`]*)`", text)


@pytest.mark.parametrize("name", NAMES)
def test_every_command_that_a_page_types_exists_with_its_options(name):
    """As the program itself lists them."""
    text = (ROOT / name).read_text(encoding="utf-8")
    wrong = {line: unknown for line in typed(text) if (unknown := commands.unknown_in(line))}
    assert not wrong


@pytest.mark.parametrize(
    ("line", "unknown"),
    [
        ("mocap track a.csv --fps 700 --out o", []),
        ("mocap track a.csv --frames-a-second 700", ["--frames-a-second"]),
        ("mocap tracks a.csv", ["mocap tracks"]),
        ("mocap calibrate images boards/ --square-mm=25 --fps 3", ["--fps"]),
        ("mocap calibrate pictures boards/", ["mocap calibrate pictures"]),
        ("mocap --help", []),
        ("mocap view a    # --nothing", []),
        ("make demo --fast", []),
    ],
)
def test_what_does_not_exist_is_seen(line, unknown):
    """Wrong commands and options are named, comments and other programs are not looked at."""
    assert commands.unknown_in(line) == unknown


@pytest.mark.parametrize("name", [name for name in NAMES if name.endswith(".md")])
def test_links_between_pages_lead_somewhere(name):
    """Files and headings of this repository; pages that the build makes are there too."""
    path = ROOT / name
    wrong = []
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"\w+:", link):
            continue
        place, _, anchor = link.partition("#")
        target = (path.parent / place).resolve() if place else path
        made = target.relative_to(ROOT / "docs").as_posix() if target.is_relative_to(ROOT / "docs") else ""
        executed = re.fullmatch(r"(tutorials|gallery)/executed/(\w+)\.rst", made)
        if executed:
            file = "GALLERY_HEADER.rst" if executed[2] == "index" else f"{executed[2]}.py"
            target = ROOT / "docs" / "scripts" / executed[1] / file
        there = made in PAGES or target.is_file()
        if not there or (anchor and made not in PAGES and anchor not in anchors(target)):
            wrong.append(link)
    assert not wrong


def anchors(path: Path) -> set[str]:
    """Of the headings of a page, as MyST and GitHub name them."""
    titles = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def test_every_page_of_the_source_names_a_page_that_is_there():
    """Docstrings and messages that send a reader to docs/..."""
    wrong = []
    for folder in ("mocap", "eal", "filters", "datasets", "benchmarks"):
        for path in (ROOT / folder).rglob("*.py"):
            for page in re.findall(r"\bdocs/[\w/]+\.md", path.read_text(encoding="utf-8")):
                if not (ROOT / page).is_file() and page.removeprefix("docs/") not in PAGES:
                    wrong.append(f"{path.relative_to(ROOT)}: {page}")
    assert not wrong


def kinds(error: type[MocapError]) -> list[type[MocapError]]:
    """An error class and all below it."""
    return [error, *(kind for below in error.__subclasses__() for kind in kinds(below))]


def test_errors_name_pages_that_are_there(mocap, tmp_path):
    """The command line says the page at the end of the one line: of the kind of error, else of the command."""
    names = "cli.main", "cameras.arrangement", "joint_design.flexure", "rerun.viewer", "rerun.stored", "io.movies"
    for name in names:
        import_module(f"mocap.{name}")
    pages = {kind.page for kind in kinds(MocapError) if kind.page is not None}
    assert {"your_files", "skeleton", INSTALLING} <= pages
    assert pages <= topics().keys()
    (tmp_path / "a.txt").write_text("no table\n")
    code, _, err = mocap("track", tmp_path / "a.txt", "--fps", 100, "--out", tmp_path / "out")
    assert code == 1
    assert err.strip().endswith("; see: mocap help your_files")
    assert len(err.strip().splitlines()) == 1
    code, _, err = mocap("kinematics", tmp_path, "--export", "pdf")
    assert code == 1
    assert err.strip().endswith("; see: mocap help kinematics")
    assert topics().keys() | {None} >= {entry.page for entry in ENTRIES.values()}


@pytest.mark.parametrize("kind", [kind for kind in Kind if kind.harm is not Harm.NOTHING])
def test_the_manual_says_what_to_do_about_every_kind_of_alarm(kind):
    """The entry is on the page, names no page that a report cannot reach, and is one entry's alone."""
    assert sum(kind in kinds for kinds in SYMPTOMS.values()) == 1
    title, text = what_to_do(kind)
    assert f"**{title}**" in " ".join(topics()["troubleshooting"].split())
    assert ".md" not in text


def templates() -> list[list[str]]:
    """Every text of the program, in the parts between values that it fills in; options as the command types them."""
    found = set()
    for folder in ("mocap", "filters", "eal"):
        for path in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.JoinedStr):
                    text = "".join(str(v.value) if isinstance(v, ast.Constant) else "\0" for v in node.values)
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    text = node.value
                else:
                    continue
                text = re.sub(r"`(\w+)`", lambda name: "--" + name[1].replace("_", "-"), text).strip("\0 :;")
                if sum(c.islower() for c in text) >= 6:
                    found.add(text)
    return [text.split("\0") for text in found]


def said(message: str, texts: list[list[str]]) -> list[bool]:
    """Which characters of a message one of the texts has, all its parts in order; the message may end before it."""
    covered = [False] * len(message)
    for first, *rest in texts:
        at = message.find(first)
        while at >= 0:
            end = at + len(first)
            for part in rest:
                following = message.find(part, end)
                if following < 0:
                    cut = end == len(message) or any(part.startswith(message[k:]) for k in range(end, len(message) - 2))
                    end = len(message) if cut else 0
                    break
                end = following + len(part)
            covered[at:end] = [True] * max(end - at, 0)
            at = message.find(first, at + 1)
        if first.startswith(message):
            return [True] * len(message)
    return covered


def test_messages_that_pages_quote_are_those_of_the_program():
    """In tables of what can go wrong: but for values, at most two words of a message are in no text of the program."""
    texts, wrong, seen = templates(), {}, 0
    for page in (ROOT / "docs" / "howto").rglob("*.md"):
        _, _, table = page.read_text(encoding="utf-8").partition("| message | do |")
        for message in re.findall(r"^\| `([^`]+)`", table, re.MULTILINE):
            message = message.rstrip(". ")
            covered = said(message, texts)
            words = [w for w in re.finditer(r"\S+", message) if re.fullmatch(r"\(?[A-Za-z-]{2,}[,;:)]*", w[0])]
            unknown = [word[0] for word in words if not all(covered[word.start() : word.end()])]
            seen += 1
            if len(unknown) > 2:
                wrong[f"{page.name}: {message}"] = unknown
    assert seen > 50
    assert not wrong


def test_pages_are_read_without_the_site(mocap):
    """Each by its name, without what only the site can show; names are told apart; a wrong one is refused."""
    pages = [path for room in ROOMS for path in (ROOT / "docs" / room).glob("*.md")]
    assert len(topics()) == len([path for path in pages if path.stem != "index"])
    code, out, _ = mocap("help")
    assert code == 0
    assert all(name in out for name in topics())
    for name in topics():
        code, out, _ = mocap("help", name)
        assert code == 0
        assert not re.search(r"\{(image|toctree|eval-rst)\}", out)
    code, _, err = mocap("help", "howto")
    assert code == 1
    assert "mocap help lists them" in err


def test_mocap_alone_says_what_to_do_next(mocap, monkeypatch):
    """Five lines of commands that exist, and success; by the name that can be called again."""
    code, out, _ = mocap()
    lines = out.strip().splitlines()
    assert code == 0
    assert len(lines) == 5
    assert all(line.startswith("mocap ") and not commands.unknown_in(line.split("   ")[0]) for line in lines)
    assert set(re.findall(r"mocap help (\w+)", out)) < topics().keys()
    monkeypatch.setattr("sys.prefix", "/home/a/.cache/uv/archive-v0/Xs3")  # uvx: there is no command mocap
    again = mocap()[1]
    assert again.count("uvx eal-mocap ") == out.count("mocap ") == 7
    assert "<bool>" not in mocap("--help")[1]


def test_the_readme_is_short_and_its_pictures_are_there():
    """At most 100 lines, the two commands among the first forty."""
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= README_LINES
    assert {"make demo", "make test"} <= {" ".join(line.split()[:2]) for line in lines[:40]}
    assert all((ROOT / name).is_file() for name in re.findall(r"!\[[^]]*\]\(([^)]+)\)", "\n".join(lines)))


@pytest.mark.parametrize("name", NAMES)
def test_blocks_of_toml_are_toml(name):
    """As a person pastes them."""
    for block in re.findall(r"```toml\n(.*?)```", (ROOT / name).read_text(encoding="utf-8"), re.DOTALL):
        tomllib.loads(block)


def test_the_pages_can_be_read():
    """All of them together have at most so many words, a picture's or a table's included."""
    others = {"experiments", "paper", "releasing"}
    pages = [ROOT / "README.md", *(p for p in (ROOT / "docs").rglob("*.md") if not others & {*p.parts})]
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in pages) <= WORDS


EXPERIMENTS = 15_000
"""Words of all pages of ``docs/experiments/``: one table a decision; the rest is in the history."""


def test_the_diary_is_short_and_all_of_it_is_linked():
    """Pages of at most 1000 words, each named by the list of them."""
    folder = ROOT / "docs" / "experiments"
    words = {page.name: len(page.read_text(encoding="utf-8").split()) for page in folder.glob("*.md")}
    assert sum(words.values()) <= EXPERIMENTS
    assert max(words.values()) <= 1000
    linked = set(re.findall(r"\]\((\w+\.md)\)", (folder / "README.md").read_text(encoding="utf-8")))
    assert words.keys() - {"README.md"} == linked


def test_the_version_is_one():
    """That of ``pyproject.toml``; ``CITATION.cff`` repeats it, and the changelog has a section of it."""
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert f"\nversion: {stated}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\n## {stated}\n" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f'version: "{stated}"' in (ROOT / "docs" / "releasing" / "recipe.yaml").read_text(encoding="utf-8")


def test_the_paper_and_the_citation_agree():
    """Title and authors: who they are is stated by them, and until then by none."""
    cited = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    paper = (ROOT / "docs" / "paper" / "paper.md").read_text(encoding="utf-8")
    for field in ("title", "authors:\n  - name"):
        (of_paper,), (cited_as,) = (re.findall(rf"^{field}: (.*)$", text, re.M) for text in (paper, cited))
        assert of_paper == cited_as


def test_the_newest_version_is_read_in_a_minute():
    """Sixty lines, by area, begun by what a user must do: the log has the rest."""
    newest = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split("\n## ")[1]
    assert sum(bool(line.strip()) for line in newest.splitlines()[1:]) <= 60
    assert re.findall(r"^\*\*(.+)\*\*$", newest, re.MULTILINE)[0] == "What you must do"


def test_the_paper_has_the_numbers_that_its_script_stored():
    """Its table is made of ``numbers.json``; its figure is there; every work that it cites is listed, and no other."""
    folder = ROOT / "docs" / "paper"
    text = (folder / "paper.md").read_text(encoding="utf-8")
    assert numbers.table(json.loads((folder / "numbers.json").read_text(encoding="utf-8"))) in text
    assert (folder / re.findall(r"\]\((\w+\.png)\)", text)[0]).is_file()
    cited = set(re.findall(r"@(\w+)", text.partition("---\n# Summary")[2] or text))
    assert cited == set(re.findall(r"^@\w+\{(\w+),", (folder / "paper.bib").read_text(encoding="utf-8"), re.MULTILINE))


def test_the_reference_describes_every_command():
    """Each command has its section and each option its row."""
    page = commands.page()
    for name, command in commands.commands().items():
        section = page.split(f"## {name}\n", 1)[1].split("\n## ", 1)[0]
        assert all(f"`{option}`" in section for option in commands.options(command) - {"--help"})


@pytest.mark.parametrize("path", [path for path in TEXTS if path.parent.name != "experiments"])
def test_examples_import_what_they_use(path):
    """A block of Python that is copied after those above it on its page has its modules."""
    blocks = re.findall(r"^```python\n(.*?)^```", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    known: set[str] = set()
    for block in blocks:
        nodes = list(ast.walk(ast.parse(block)))
        brought = [n for n in nodes if isinstance(n, ast.Import | ast.ImportFrom)]
        known |= {(one.asname or one.name).split(".")[0] for n in brought for one in n.names}
        used = {n.id for n in nodes if isinstance(n, ast.Name)} & {"eal", "mocap", "np", "pd", "plt", "xr"}
        assert used <= known, block


def example(name: str) -> dict:
    """What a block of code of the page about extending defines, found by a word in it."""
    page = (ROOT / "docs" / "howto" / "extend.md").read_text(encoding="utf-8")
    (block,) = [b for b in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if name in b]
    defined: dict = {"__name__": "example"}
    exec(compile(block, name, "exec"), defined)
    return defined


def test_the_example_of_a_format_reads(tmp_path):
    """Centimetres become metres, an empty cell is a gap, and another first line is refused with both."""
    made = example("birdlab")["read_birdlab"]
    path = tmp_path / "a.txt"
    path.write_text("# BIRDLAB 200 Hz\nbeak,tail\n100,0,0,1,2,3\n,,,4,5,6\n")
    assert made.knows(head(path))
    found = read_as(made, path, Hints())
    assert found.fps == 200
    assert found.points is not None
    np.testing.assert_allclose(found.points.xyz_m[0, 0], [1.0, 0.0, 0.0])
    assert np.isnan(found.points.xyz_m[1, 0]).all()
    path.write_text("# BIRDLAB\nbeak\n1,2,3\n")
    with pytest.raises(FormatError, match="'# BIRDLAB'; expected"):
        read_as(made, path, Hints())


def test_the_example_of_a_motion_model_fills_a_gap():
    """A marker that goes straight on is filled on its line."""
    model = example("class RestingSettings")["RestingSettings"]()
    t_s = np.arange(40) / 100
    truth = np.stack([t_s, 2 * t_s, 0 * t_s], axis=1)[:, None] + np.array([[0.0, 0, 0], [0.1, 0, 0]])
    shown = truth.copy()
    shown[15:25, 0] = np.nan
    trial = MarkerTrial(name="a", t_s=t_s, xyz_m=shown, sd_m=np.full(shown.shape[:2], 1e-4))
    observations = PositionObservations(xyz_m=trial.xyz_m, sd_m=trial.sd_m)
    filled = estimate(model, TrialSet([trial], Anatomy((0, 1))), observations)
    page = (ROOT / "docs" / "howto" / "extend.md").read_text(encoding="utf-8")
    (named,) = [block for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "RESTING =" in block]
    scope: dict = {"RestingSettings": type(model)}
    exec(compile(named, "RESTING", "exec"), scope)
    assert scope["RESTING"].settings == model
    assert not scope["RESTING"].posed
    assert set(scope["RESTING"].beside) <= NAMED.keys()
    np.testing.assert_allclose(filled.xyz_m[15:25, 0], truth[15:25, 0], atol=1e-3)


def test_the_example_of_a_kernel_has_the_slopes_it_states():
    """Gradient of log K by differences; V_z is low at the samples and high far from them."""
    kernel = example("RationalKernel")["RationalKernel"](beta=2.0)
    rng = np.random.default_rng(0)
    q, z, step = rng.normal(size=(1, 2)), rng.normal(size=(5, 2)), 1e-6
    for axis in np.eye(2):
        slope = (kernel.log_gram(q + step * axis, z) - kernel.log_gram(q - step * axis, z)) / (2 * step)
        np.testing.assert_allclose(kernel.log_gradients(q, z) @ axis, slope, atol=1e-8)
    potential = fit_potential(rng.normal(size=(60, 2)), kernel=kernel, lam=1e-3)
    assert potential.value(potential.samples).max() < 0.1
    assert potential.value(np.array([30.0, 30.0])) > 0.9


def test_what_another_host_would_send_is_seen(tmp_path):
    """Scripts, styles and pictures from elsewhere, missing files and anchors are trouble; links for readers are not."""
    (tmp_path / "style.css").write_text("a { background: url(https://x.org/a.png) }")
    (tmp_path / "b.html").write_text("<h1 id='there'>b</h1>")
    (tmp_path / "a.html").write_text(
        "<script src='https://cdn.org/a.js'></script><img src='missing.png'><link rel='stylesheet' href='style.css'>"
        "<a href='https://x.org'>x</a><a href='b.html#there'>b</a><a href='b.html#gone'>b</a><a href='c.html'>c</a>"
    )
    found = html.troubles(tmp_path)
    assert len(found) == 5
    for word in ("cdn.org", "missing.png", "#gone", "c.html", "x.org/a.png"):
        assert sum(word in line for line in found) == 1


def test_a_column_that_nobody_described_is_seen():
    """Names stand only for what they may stand for."""
    names = {"marker": ["tip", "tip_2"]}
    assert columns.undocumented(["frame", "tip_2_x", "tip_origin"], "markers.csv", names) == []
    assert columns.undocumented(["root_x", "tip_xyz", "tip_sd_m"], "markers.csv", names) == [
        "root_x",
        "tip_xyz",
        "tip_sd_m",
    ]


@pytest.mark.slow
def test_the_licences_page_has_every_package_of_the_locks():
    """In the version that a lock has, extras too, and nothing else; what it says of a wheel is what lies in it."""
    stored, made = (
        {row[0]: row for row in table_rows(page)}
        for page in (licences.PAGE.read_text(encoding="utf-8"), licences.page())
    )
    locks = [(ROOT / f"requirements{kind}.lock").read_text(encoding="utf-8") for kind in ("", "-dev")]
    pinned: dict[str, set[str]] = {}  # a lock holds several versions where Python's decides
    for name, version in re.findall(r"^([\w.-]+)==([^\s;]+)", "\n".join(locks), re.MULTILINE):
        pinned.setdefault(name, set()).add(version)
    absent = {name for name in stored if " " not in name}
    assert {name.partition(" ")[0] for name in stored} == pinned.keys()
    assert all(version in pinned[name] for name, _, version in (row.partition(" ") for row in stored.keys() - absent))
    assert all("only where" in stored[name][2] for name in absent)
    assert "x264" in next(row for name, row in made.items() if name.startswith("av "))[3]
    assert len(next(row for name, row in made.items() if name.startswith("pillow "))[3].split(", ")) >= 10
    if (sys.platform, platform.machine(), sys.version_info[:2]) == ("linux", "x86_64", (3, 11)):
        same = made.keys() & stored.keys()  # in the locked versions; what needs it depends on all of them
        assert {name: made[name][2:] for name in same} == {name: stored[name][2:] for name in same}


def table_rows(page: str) -> list[list[str]]:
    """Cells of the table that is made, without its head."""
    table = page.split(licences.BEGIN)[1].split(licences.END)[0]
    return [
        [cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line.startswith("| ")
    ][1:]


def test_locks_name_no_hosts():
    """Where packages come from is the business of who installs."""
    locks = sorted(ROOT.glob("requirements*.lock"))
    assert len(locks) == 3
    assert not [
        lock.name for lock in locks if re.search(r"https?:|--(extra-)?index|--find", lock.read_text(encoding="utf-8"))
    ]
