"""Damage to files, from seeds: what disks, editors, spreadsheets and scripts do to them."""

import re

import numpy as np

NUMBERS = (
    *("1e30", "-1e30", "1e9", "-81", "9223372036854775808", "1_000", "\uff11\uff12", "0x1p3", "inf", "-inf"),
    *("infinity", "1e400", "-0.0", "0", "1,5", "1.5.2", "--3", "None", "\u00b2"),
)
"""What stands in place of a number."""
NUMBERS_OF = {"f": (1e30, -1e30, np.inf, np.nan, -81.0, 0.0), "i": (-1, 32767, -81, 0)}
"""The same in binary files: reals and whole numbers."""
UNITS = ("mm", "cm", "m", "um", "in", "furlong", "")
_CELL = re.compile(r"[^,\t\n;]+")
TEXT = ("bits", "cut", "insert", "delete", "columns", "more", "fewer", "number", "frame", "unit", "ends", "lines")
BINARY = ("bits", "head bits", "cut", "insert", "delete", "number", "blocks", "unit")


def kinds(content: bytes) -> tuple[str, ...]:
    """The kinds of damage that there are for a file."""
    return BINARY if b"\0" in content else TEXT


def damaged(content: bytes, kind: str, rng: np.random.Generator) -> bytes:
    """The content with one kind of damage, once to three times."""
    data, bytewise = content, kind in _BYTES or b"\0" in content
    for _ in range(int(rng.integers(1, 4)) if kind not in ("cut", "ends", "columns") else 1):
        data = (_bytes if bytewise else _text)(data, kind, rng)
    return data


_BYTES = ("bits", "head bits", "cut", "insert", "delete", "blocks")


def _bytes(content: bytes, kind: str, rng: np.random.Generator) -> bytes:
    data = bytearray(content)
    size = len(data) or 1
    at, length = int(rng.integers(size)), int(rng.integers(1, 40))
    if kind == "cut":
        return bytes(data[:at])
    if kind in ("bits", "head bits"):
        at = int(rng.integers(min(size, 6000))) if kind == "head bits" else at
        data[at : at + 1] = bytes([data[at] ^ (1 << int(rng.integers(8)))]) if data else b"\1"
    elif kind == "insert":
        data[at:at] = data[at : at + length] if rng.random() < 0.5 else rng.bytes(length)
    elif kind == "delete":
        del data[at : at + length]
    elif kind == "number":
        order, kind = rng.choice(["<", ">"]), rng.choice(["f4", "f8", "i2", "i4"])
        value = rng.choice(NUMBERS_OF[str(kind)[0]])
        number = np.array(value).astype(f"{order}{kind}").tobytes()
        data[at : at + len(number)] = number
    elif kind == "blocks":
        block = int(rng.choice([64, 512, 4096]))
        one, other = (block * int(rng.integers(size // block + 1)) for _ in range(2))
        data[one : one + block], data[other : other + block] = data[other : other + block], data[one : one + block]
    elif kind == "unit":
        place = data.find(rng.choice(np.array([b"mm", b"cm", b"m ", b"UNITS", b"RATE"], dtype=object)))
        if place >= 0:
            data[place : place + 1] = rng.choice(np.array([b"c", b"k", b" ", b"\0"], dtype=object))
    return bytes(data)


def _text(content: bytes, kind: str, rng: np.random.Generator) -> bytes:
    text = content.decode("utf-8", "surrogateescape")
    if kind == "ends":
        end = str(rng.choice(["\r\n", "\r", "\r\r\n", "mixed"]))
        ends = [
            str(rng.choice(["\n", "\r\n", "\r", "\r\r\n"])) if end == "mixed" else end for _ in range(text.count("\n"))
        ]
        parts = text.split("\n")
        text = "".join(part + end for part, end in zip(parts, [*ends, ""], strict=True))
        return text.encode("utf-8", "surrogateescape")
    lines = text.split("\n")
    row = int(rng.integers(len(lines)))
    mark = max(",\t ", key=lines[row].count)
    cells = lines[row].split(mark)
    cell = int(rng.integers(len(cells)))
    if kind == "columns":
        one, other = sorted(int(i) for i in rng.integers(len(cells), size=2))
        start = row if rng.random() < 0.5 else int(rng.integers(min(len(lines), 6)))
        for i in range(start, len(lines)):
            parts = lines[i].split(mark)
            if len(parts) > other:
                parts[one], parts[other] = parts[other], parts[one]
                lines[i] = mark.join(parts)
    elif kind == "lines":
        other = int(rng.integers(len(lines)))
        lines[row], lines[other] = lines[other], lines[row]
    elif kind == "unit":
        place = [i for i, line in enumerate(lines[:12]) if re.search(r"\b(mm|cm|m|hz|Hz)\b", line)]
        if place:
            lines[place[0]] = re.sub(
                r"\b(mm|cm|m)\b", str(rng.choice(UNITS)), lines[place[0]], count=int(rng.integers(2))
            )
    else:
        if kind == "more":
            cells.insert(cell, str(rng.choice(["", "7.5", "NaN", cells[cell]])))
        elif kind == "fewer":
            del cells[cell]
        elif kind == "number":
            cells[cell] = str(rng.choice(NUMBERS))
        elif kind == "frame":
            cells[0] = str(rng.choice(["1000000000", "-81", "9223372036854775808", "1.5", "", "0", "3", "1e5"]))
        lines[row] = mark.join(cells)
    return "\n".join(lines).encode("utf-8", "surrogateescape")
