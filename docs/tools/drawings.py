"""Drawings of the quantities of ``docs/reference/kinematics.md``: ``python -m docs.tools.drawings`` writes them anew.

Colours are those of Okabe & Ito (2008), told apart by all kinds of sight; what is measured is orange, axes are blue.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parents[1] / "pictures" / "kinematics"
INK, BONE, BLUE, ORANGE, GREEN = "#222222", "#8da5b5", "#0072b2", "#d55e00", "#009e73"
WIDTH, HEIGHT = 320, 180
Place = tuple[float, float]


def line(a: Place, b: Place, *, colour: str = INK, width: float = 2, dash: bool = False) -> str:
    """From a to b."""
    dashed = ' stroke-dasharray="5 4"' if dash else ""
    return (
        f'<line x1="{a[0]:g}" y1="{a[1]:g}" x2="{b[0]:g}" y2="{b[1]:g}" stroke="{colour}" stroke-width="{width:g}" '
        f'stroke-linecap="round"{dashed}/>'
    )


def arrow(a: Place, b: Place, *, colour: str = INK, width: float = 2) -> str:
    """From a to b, its head at b."""
    along = np.subtract(b, a) / max(float(np.hypot(*np.subtract(b, a))), 1e-9)
    across = np.array([-along[1], along[0]])
    tips = [b - 9 * along + side * 4.5 * across for side in (1, -1)]
    head = " ".join(f"{x:.1f},{y:.1f}" for x, y in (b, *tips))
    stop = b - 6 * along
    return line(a, (float(stop[0]), float(stop[1])), colour=colour, width=width) + (
        f'<polygon points="{head}" fill="{colour}"/>'
    )


def path(
    points: Sequence[Place], *, colour: str = INK, fill: str = "none", width: float = 2, closed: bool = False
) -> str:
    """Through points."""
    way = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    shape = "polygon" if closed else "polyline"
    opacity = ' fill-opacity="0.18"' if fill != "none" else ""
    return f'<{shape} points="{way}" fill="{fill}"{opacity} stroke="{colour}" stroke-width="{width:g}"/>'


def arc(centre: Place, radius: float, start_deg: float, stop_deg: float, *, colour: str = ORANGE) -> str:
    """Part of a circle, counterclockwise from the x axis, its head at the stop."""
    angles = np.radians(np.linspace(start_deg, stop_deg, 30))
    points = [(centre[0] + radius * float(np.cos(a)), centre[1] - radius * float(np.sin(a))) for a in angles]
    return path(points[:-3], colour=colour) + arrow(points[-5], points[-1], colour=colour)


def dot(at: Place, *, colour: str = INK) -> str:
    """A marker."""
    return f'<circle cx="{at[0]:g}" cy="{at[1]:g}" r="4.5" fill="{colour}"/>'


def text(at: Place, words: str, *, colour: str = INK, anchor: str = "start") -> str:
    """Words, in the given colour."""
    return f'<text x="{at[0]:g}" y="{at[1]:g}" fill="{colour}" text-anchor="{anchor}">{words}</text>'


def flexion() -> list[str]:
    """Included angle and flexion."""
    a, b, c, on = (40, 130), (150, 90), (270, 130), (260, 50)
    return [
        line(a, b, colour=BONE, width=7),
        line(b, c, colour=BONE, width=7),
        line(b, on, dash=True),
        *(dot(p) for p in (a, b, c)),
        arc(b, 42, 200, 342, colour=BLUE),
        arc(b, 62, 20, -18),
        text((150, 155), "angle", colour=BLUE, anchor="middle"),
        text((218, 92), "flexion", colour=ORANGE),
        text((30, 158), "parent"),
        text((150, 74), "centre", anchor="middle"),
        text((262, 158), "child"),
    ]


def three_angles() -> list[str]:
    """Flexion, abduction and rotation of a child segment about the axes of its parent."""
    o, x, y, z = (120, 110), (30, 150), (120, 30), (190, 150)
    end = (265, 62)
    return [
        line(x, o, colour=BONE, width=7),
        line(o, end, colour=BONE, width=7),
        arrow(o, y, colour=BLUE),
        arrow(o, z, colour=BLUE),
        dot(o),
        text((126, 34), "y", colour=BLUE),
        text((196, 156), "z", colour=BLUE),
        text((18, 172), "x: long axis of the parent", colour=BLUE),
        arc((178, 141), 14, 250, 560),
        text((206, 140), "flexion", colour=ORANGE),
        arc((120, 48), 14, 180, 500),
        text((140, 58), "abduction", colour=ORANGE),
        arc((242, 72), 16, 110, 400),
        text((200, 36), "rotation", colour=ORANGE),
    ]


def velocity() -> list[str]:
    """Velocity along the path of a marker, and acceleration, its change."""
    t = np.linspace(0, 1, 40)
    way = [(30 + 250 * float(s), 150 - 105 * float(np.sin(2.2 * s))) for s in t]
    at = way[14]
    return [
        path(way, colour=BONE),
        dot(at),
        arrow(at, (at[0] + 68, at[1] - 44), colour=ORANGE),
        arrow(at, (at[0] + 22, at[1] + 52), colour=GREEN),
        text((at[0] + 20, at[1] - 50), "velocity", colour=ORANGE, anchor="end"),
        text((at[0] + 32, at[1] + 58), "acceleration", colour=GREEN),
        text((260, 100), "path of a marker", anchor="end"),
    ]


def course() -> list[str]:
    """Heading seen from above, climb seen from the side."""
    a, b = (30, 130), (190, 130)
    return [
        text((30, 24), "from above"),
        arrow(a, (130, 130), colour=BLUE),
        text((112, 150), "x", colour=BLUE),
        arrow(a, (30, 50), colour=BLUE),
        text((12, 60), "y", colour=BLUE),
        arrow(a, (115, 65)),
        arc(a, 50, 0, 37),
        text((86, 120), "heading", colour=ORANGE),
        text((190, 24), "from the side"),
        line(b, (300, 130), colour=BLUE, dash=True),
        arrow(b, (285, 75)),
        arc(b, 60, 0, 30),
        text((256, 122), "climb", colour=ORANGE),
        text((222, 78), "velocity", anchor="end"),
    ]


def attitude() -> list[str]:
    """Yaw from above, pitch from the side, roll from behind."""
    out: list[str] = []
    for left, name, view, turn in ((20, "yaw", "from above", 30), (125, "pitch", "from the side", 25)):
        o, tip = (left, 130), (left + 75 * np.cos(np.radians(turn)), 130 - 75 * np.sin(np.radians(turn)))
        out += [text((left, 30), view), line(o, (left + 80, 130), colour=BLUE, dash=True)]
        out += [arrow(o, tip, width=4), arc(o, 48, 0, turn), text((left + 54, 122), name, colour=ORANGE)]
    o = (270, 110)
    out += [text((230, 30), "from behind"), line((230, 110), (312, 110), colour=BLUE, dash=True)]
    out += [line((233, 96), (307, 124), colour=BONE, width=7), arc(o, 34, 180, 160)]
    out += [text((230, 84), "roll", colour=ORANGE), text((312, 150), "left side up: positive", anchor="end")]
    return out


def sizes() -> list[str]:
    """Length of a bone, a span, the area of an outline."""
    outline = [(120, 140), (150, 60), (230, 30), (290, 80), (215, 150)]
    return [
        path(outline, colour=GREEN, fill=GREEN, closed=True),
        *(dot(p) for p in outline),
        text((200, 100), "area", colour=GREEN, anchor="middle"),
        line((30, 150), (60, 50), colour=BONE, width=7),
        dot((30, 150)),
        dot((60, 50)),
        text((18, 36), "length of a bone"),
        line((120, 160), (290, 160), colour=ORANGE),
        line((120, 155), (120, 165), colour=ORANGE),
        line((290, 155), (290, 165), colour=ORANGE),
        text((205, 178), "distance, span", colour=ORANGE, anchor="middle"),
    ]


def stroke() -> list[str]:
    """Angle of a limb in its stroke plane, and out of it."""
    o = (60, 100)
    plane = [(60, 100), (250, 20), (275, 100), (250, 170)]
    return [
        path(plane, colour=BLUE, fill=BLUE, closed=True),
        line(o, (265, 100), colour=BLUE, dash=True),
        line(o, (240, 50), colour=BONE, width=6),
        dot(o),
        dot((240, 50)),
        arc(o, 110, 0, 15),
        text((186, 94), "stroke", colour=ORANGE),
        text((20, 122), "root"),
        text((232, 72), "tip"),
        text((180, 150), "stroke plane", colour=BLUE, anchor="middle"),
        arrow((240, 50), (276, 32), colour=GREEN),
        text((316, 24), "deviation", colour=GREEN, anchor="end"),
    ]


def beat() -> list[str]:
    """A wing beat between upper turning points: amplitude, down-stroke, phase."""
    t = np.linspace(0, 1, 80)
    curve = [(40 + 240 * float(s), 90 - 45 * float(np.cos(2 * np.pi * 1.25 * s))) for s in t]
    return [
        arrow((30, 160), (305, 160)),
        text((300, 176), "time", anchor="end"),
        path(curve, colour=BLUE),
        dot((40, 45)),
        dot((232, 45)),
        line((136, 45), (136, 135), colour=GREEN),
        text((142, 94), "amplitude", colour=GREEN),
        line((40, 30), (232, 30), colour=ORANGE),
        text((136, 24), "one cycle: phase 0 to 360", colour=ORANGE, anchor="middle"),
        line((40, 150), (136, 150), colour=INK, width=3),
        text((88, 146), "down-stroke", anchor="middle"),
    ]


def gait() -> list[str]:
    """Footfalls, contact and stride of one foot."""
    return [
        text((20, 50), "stands"),
        line((80, 45), (150, 45), colour=BLUE, width=12),
        line((230, 45), (300, 45), colour=BLUE, width=12),
        line((80, 45), (80, 150), dash=True),
        line((230, 45), (230, 150), dash=True),
        line((80, 80), (150, 80), colour=GREEN),
        text((115, 98), "contact", colour=GREEN, anchor="middle"),
        line((80, 120), (230, 120), colour=ORANGE),
        text((155, 138), "stride", colour=ORANGE, anchor="middle"),
        text((20, 168), "duty factor = contact / stride", colour=INK),
    ]


def wave() -> list[str]:
    """A wave along a body: wavelength, amplitude, lag of phase."""
    s = np.linspace(0, 1, 80)
    body = [(30 + 260 * float(u), 85 - 35 * float(np.sin(2 * np.pi * 1.4 * u))) for u in s]
    marks = [body[i] for i in (0, 16, 32, 48, 64, 79)]
    return [
        path(body, colour=BONE, width=6),
        *(dot(p) for p in marks),
        text((20, 110), "head"),
        text((300, 130), "tail", anchor="end"),
        line((76, 150), (262, 150), colour=ORANGE),
        text((169, 168), "wavelength", colour=ORANGE, anchor="middle"),
        line((76, 50), (76, 85), colour=GREEN),
        text((84, 44), "amplitude", colour=GREEN),
    ]


def moment() -> list[str]:
    """Force and moment across a joint on the segment beyond it, and gravity."""
    c, end = (110, 70), (240, 120)
    middle = (175, 95)
    return [
        line((30, 60), c, colour=BONE, width=7),
        line(c, end, colour=BONE, width=7),
        dot(c),
        dot(end),
        arrow(middle, (175, 150)),
        text((182, 150), "mass x gravity"),
        arrow(c, (128, 18), colour=GREEN),
        text((136, 22), "force", colour=GREEN),
        arc(c, 30, 320, 560),
        text((60, 118), "moment", colour=ORANGE, anchor="middle"),
    ]


DRAWINGS: dict[str, Callable[[], list[str]]] = {
    "flexion": flexion,
    "three_angles": three_angles,
    "velocity": velocity,
    "course": course,
    "attitude": attitude,
    "sizes": sizes,
    "stroke": stroke,
    "beat": beat,
    "gait": gait,
    "wave": wave,
    "moment": moment,
}


def svg(name: str) -> str:
    """The file of one drawing."""
    parts = "\n  ".join(DRAWINGS[name]())
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        f'font-family="sans-serif" font-size="13">\n  <rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>\n  '
        f"{parts}\n</svg>\n"
    )


def main() -> None:
    """Write all."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in DRAWINGS:
        (FOLDER / f"{name}.svg").write_text(svg(name), encoding="utf-8")


if __name__ == "__main__":
    main()
