"""Odd but sound files: what other programs write, which must be read with the values of the plain file beside them.

Each is made of a sound one by what a program of the trade is known to do. ``run`` reads all and prints which are read
with the same values, which with others, and which are refused: the last two are defects.
"""

import argparse
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.attack.files import compared, values_of
from mocap.errors import FormatError
from mocap.io.contents import point_recording
from mocap.io.registry import read, write

FRAMES, NAMES = 40, ("RASI", "LASI", "SACR")
XYZ_MM = np.cumsum(np.random.default_rng(0).normal(0, 1, (FRAMES, 3, 3)), axis=0).astype(np.float32).astype(float) + 100


def c3d(folder: Path) -> bytes:
    """A plain file: reals of Intel's order, as this program writes them (ezc3d reads the same values)."""
    path = folder / "plain.c3d"
    write(point_recording(path, "made", names=NAMES, xyz=XYZ_MM, unit="mm", fps=100.0), path)
    return path.read_bytes()


def _begin(data: bytes) -> int:
    return 512 * (struct.unpack_from("<H", data, 16)[0] - 1)


def _blocks(data: bytes) -> bytes:
    """OptiTrack Motive: more blocks of parameters are counted than lie before the data."""
    return data[:514] + b"\x08" + data[515:]


def _few_blocks(data: bytes) -> bytes:
    """Motion Reality: fewer are counted than there are."""
    return data[:514] + b"\x00" + data[515:]


def _twice(data: bytes) -> bytes:
    """Vicon Plug-in Gait: a parameter of no interest is given twice, with two values."""
    end = data.index(b"\x00\x00\x00\x00", data.index(b"RATE", data.index(b"ANALOG")) + 16)
    group = bytes([10, 253]) + b"PROCESSING" + struct.pack("<H", 3) + b"\0"
    more = b"".join(bytes([8, 3]) + b"BODYMASS" + struct.pack("<Hbbf", 9, 4, 0, mass) + b"\0" for mass in (70.0, 71.0))
    room = _begin(data) - end
    return data[:end] + (group + more).ljust(room, b"\0") + data[_begin(data) :]


def _padding(data: bytes) -> bytes:
    """Cortex: reserved bytes after the data, with what was in memory."""
    return data + np.random.default_rng(1).bytes(96_896)


def _no_description(data: bytes) -> bytes:
    """Older writers leave out the byte that counts the letters of a description."""
    at = data.index(b"UNITS") + 5
    size = struct.unpack_from("<H", data, at)[0]
    begin = _begin(data)
    short = data[:at] + struct.pack("<H", size - 1) + data[at + 2 : at + size - 1] + data[at + size : begin]
    return short.ljust(begin, b"\0") + data[begin:]


def _integers(data: bytes) -> bytes:
    """16-bit whole numbers, a hundredth of a millimetre each."""
    begin, scale = _begin(data), 0.01
    words = np.frombuffer(data[begin : begin + FRAMES * 48], dtype="<f4").reshape(FRAMES, 3, 4).astype(float)
    whole = np.round(np.concatenate([words[..., :3] / scale, words[..., 3:]], axis=-1)).astype("<i2")
    at = data.index(b"SCALE") + 5 + 4
    out = bytearray(data[:begin] + whole.tobytes().ljust(-(-whole.nbytes // 512) * 512, b"\0"))
    struct.pack_into("<f", out, 12, scale)
    struct.pack_into("<f", out, at, scale)
    return bytes(out)


def _word(place: int, change: int) -> Callable[[bytes], bytes]:
    def apply(data: bytes) -> bytes:
        out = bytearray(data)
        struct.pack_into("<H", out, place, struct.unpack_from("<H", data, place)[0] + change)
        return bytes(out)

    return apply


C3D: dict[str, Callable[[bytes], bytes]] = {
    "block count too large": _blocks,
    "block count too small": _few_blocks,
    "parameter twice": _twice,
    "stale bytes after the data": _padding,
    "blocks after the data": lambda data: data + bytes(2048),
    "no padding to a block": lambda data: data[: _begin(data) + FRAMES * 48],
    "description left out": _no_description,
    "16-bit whole numbers": _integers,
    "frames of the header wrong": _word(8, -7),
    "analog values of the header wrong": _word(4, 5),
    "begin of the data wrong in the header": _word(16, 1),
}


def _trc(names: str = "\t\t\t".join(NAMES) + "\t\t", count: str = "3") -> str:
    keys = "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames"
    axes = "\t".join(f"{a}{m + 1}" for m in range(3) for a in "XYZ")
    rows = "".join(
        f"{t + 1}\t{t / 100:.2f}\t" + "\t".join(f"{v:.5f}" for v in XYZ_MM[t].ravel()) + "\n" for t in range(FRAMES)
    )
    said = f"100\t100\t{FRAMES}\t{count}\tmm\t100\t1\t{FRAMES}"
    return f"PathFileType\t4\t(X/Y/Z)\ta.trc\n{keys}\n{said}\nFrame#\tTime\t{names}\n\t\t{axes}\n\n{rows}"


def _csv(first: str = "frame", quote: str = "") -> str:
    titles = [first, *(f"{name}_{a}" for name in NAMES for a in "xyz")]
    rows = [[f"{t + 1}", *(f"{v:.5f}" for v in XYZ_MM[t].ravel())] for t in range(FRAMES)]
    return "".join(",".join(f"{quote}{cell}{quote}" for cell in row) + "\n" for row in [titles, *rows])


TEXT: dict[str, tuple[str, str, str]] = {
    "unnamed trajectories": ("trc", _trc(), _trc("", "0")),
    "NumMarkers counts virtual ones": ("trc", _trc(), _trc(count="66")),
    "blanks for tabs": ("trc", _trc(), _trc().expandtabs(16).replace("\n                ", "\n")),
    "TRC without a last line end": ("trc", _trc(), _trc()[:-1]),
    "quote all": ("csv", _csv(), _csv(quote='"')),
    "frames as frame_idx": ("csv", _csv(), _csv("frame_idx")),
    "frames as any title": ("csv", _csv(), _csv("Bild-Nr.")),
    "table without a last line end": ("csv", _csv(), _csv()[:-1]),
    "line ends of old Macs": ("csv", _csv(), _csv().replace("\n", "\r")),
}
"""Ending, plain text, odd text."""


def verdict(path: Path, plain: bytes, odd: bytes, *, within: float = 0.0) -> str:
    """``same``, ``other values``, or ``refused: ...``; names may differ."""
    path.write_bytes(plain)
    sound = values_of(read(path))
    path.write_bytes(odd)
    try:
        got = values_of(read(path))
    except FormatError as error:
        return f"refused: {error}"
    if within and got["xyz"].shape == sound["xyz"].shape and np.nanmax(np.abs(got["xyz"] - sound["xyz"])) <= within:
        got["xyz"] = sound["xyz"]
    got["names"] = sound["names"]
    return "same" if compared(sound, got)[0] == "unchanged" else "other values"


def table(folder: Path) -> list[tuple[str, str, str]]:
    """Format, what is odd, verdict."""
    plain = c3d(folder)
    found = [
        ("c3d", what, verdict(folder / "a.c3d", plain, odd(plain), within=5.1e-6 if "whole" in what else 0.0))
        for what, odd in C3D.items()
    ]
    for what, (ending, text, odd) in TEXT.items():
        found.append((ending, what, verdict(folder / f"a.{ending}", text.encode(), odd.encode())))
    return found


def run(options: argparse.Namespace) -> int:
    """Print the table; the number of odd but sound files that are not read as they should be."""
    with tempfile.TemporaryDirectory() as folder:
        rows = table(Path(folder))
    for row in rows:
        print("  ".join(f"{cell:{width}}" for cell, width in zip(row, (6, 40, 0), strict=True)))
    wrong = sum(row[2] != "same" for row in rows)
    print(f"{len(rows)} odd but sound files: {wrong} not read with the values of the plain one")
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        lines = ["format,odd,verdict", *(",".join(f'"{cell}"' for cell in row) for row in rows)]
        (options.out / "sound.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return wrong
