"""Reference of the file formats, read off the registry of readers and writers."""

from mocap.entrances import as_markdown
from mocap.io.format import Format
from mocap.io.registry import formats

WORDS = {
    "pixels": "pixels",
    "points": "positions",
    "cameras": "calibration",
    "lenses": "lenses",
    "fps": "frame rate",
    "unit": "unit of length",
    "origin": "which samples are filled",
    "sd": "standard deviations",
    "score": "confidence of samples",
    "animals": "which animal a marker belongs to",
    "first_frame": "number of the first frame",
    "frame_numbers": "numbers of frames that jump",
    "pixel_origin": "corner that pixels are counted from",
}
"""What a recording may have that a file may or may not hold."""


def page() -> str:
    """All formats, what is written to each and what is lost, in Markdown."""
    written = [f for f in formats() if f.write is not None]
    lines = [
        "# File formats\n",
        f"Made from the program's registry: {sum(1 for _ in formats())} formats are read, {len(written)} of them also "
        "written. "
        "Files are recognised by content, not by name; `--format NAME` states a format where recognition fails. `mocap "
        "info FILE` says which format a file has and what is in it.\n",
        "## Formats that are written\n",
        "`mocap convert` lists, for each file, what it could not store; the columns below say it beforehand. *Needs* "
        "is what a recording must state, or you must (`--fps`, `--unit`).\n",
        "| format | name | written for | holds | cannot hold | needs |",
        "|---|---|---|---|---|---|",
    ]
    lines += [_written(f) for f in sorted(written, key=lambda f: f.title.lower())]
    lines += [
        "\nFilled samples are left as gaps in formats that cannot say which samples are filled (`--filled` writes "
        "them). Where (0, 0, 0) means a missing point, a point that lies exactly there is written 1 nm away: "
        + ", ".join(sorted(f"`{f.name}`" for f in written if f.zero_is_missing))
        + ".\n",
        "## All formats that are read\n",
        "| format | name for `--format` | written |",
        "|---|---|---|",
    ]
    lines += [
        f"| {f.title} | `{f.name}` | {'yes' if f.write is not None else ''} |"
        for f in sorted(formats(), key=lambda f: f.title.lower())
    ]
    lines += ["", "## Which command takes what", "", "Where it is refused, a part of the message.", "", as_markdown()]
    return "\n".join([*lines, ""])


def _written(format: Format) -> str:
    missing = [word for part, word in WORDS.items() if part not in format.holds]
    if "points" in format.holds and "pixels" in format.holds and not format.both:
        missing.insert(0, "pixels beside positions")
    held = [word for part, word in WORDS.items() if part in format.holds]
    held += [f"table `{part}`" for part in sorted(format.holds - WORDS.keys())]
    ends = ", ".join(f"`{end}`" for end in format.suffixes) or "`--to`"
    return (
        f"| {format.title} | `{format.name}` | {ends} | {', '.join(held)} | {', '.join(missing) or 'nothing'} | "
        f"{', '.join(sorted(WORDS[n] for n in format.needs))} |"
    )
