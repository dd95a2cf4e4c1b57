"""The skeleton in motion as BVH, for Blender, Maya, MotionBuilder and other animation programs."""

import warnings
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from eal.arrays import Array, true_runs
from mocap.errors import MocapError
from mocap.filters.anatomy import ends_among
from mocap.records import MarkerTracks
from mocap.skeleton import Skeleton

ORDER = "ZXY"
"""Order of the rotations: a child's direction is Rz Rx Ry times its direction at rest."""


def write_bvh(markers: MarkerTracks, skeleton: Skeleton, path: Path) -> None:
    """Write the skeleton in motion, in centimetres and degrees, in the axes of the recording.

    A joint of the file is a marker; its parent is the next marker on the way along bones to the root, the trunk's
    marker with most bones. The pose at rest is that of the first frame written, with bones of their median lengths.
    Each joint has three channels of position as well as three of rotation, so that markers are where they were
    tracked although measured lengths of bones change; programs that read positions of the root alone show rigid
    bones. A joint with one child turns by the least rotation from its parent; with several by the best rotation
    (Kabsch 1976). Standard deviations and status have no place in the format.

    Args:
        markers: The markers; those that never have a position, and those without bones, are left out.
        skeleton: Its bones.
        path: The file. Its frames are the longest run in which all of these markers have positions.

    Raises:
        MocapError: there are no bones, or no two frames with all markers of them.
    """
    seen = np.asarray(markers.seen)
    ever = np.asarray(seen.any(axis=0))
    bones = [(a, b) for a, b in ends_among(markers.names, [(bone.a, bone.b) for bone in skeleton.bones])]
    bones = [(a, b) for a, b in bones if ever[a] and ever[b]]
    if not bones:
        raise MocapError(
            f"skeleton {skeleton.name!r}: there are no bones between tracked markers: BVH is a tree of bones; "
            "state some under bones"
        )
    trunk = {markers.names.index(name) for name in skeleton.trunk if name in markers.names}
    parents = tree(bones, trunk)
    used = list(parents)
    runs = true_runs(np.asarray(seen[:, used].all(axis=1)))
    if not len(runs) or max(stop - start for start, stop in runs) < 2:
        raise MocapError("no two frames in a row have all markers of the bones: BVH cannot leave a joint out")
    start, stop = max(runs, key=lambda run: run[1] - run[0])
    t_s, x = markers.t_s[start:stop], markers.xyz_m[start:stop] * 100.0  # centimetres
    children = {node: [c for c, p in parents.items() if p == node] for node in used}
    rest = rest_offsets(x, parents)
    turned = rotations(x, parents, children, rest)

    head: list[str] = ["HIERARCHY"]
    channels: list[Array] = []

    def add(node: int, depth: int) -> None:
        pad, parent = "  " * depth, parents[node]
        head.append(f"{pad}{'ROOT' if parent is None else 'JOINT'} {'_'.join(markers.names[node].split())}")
        head.append(f"{pad}{{")
        head.append(f"{pad}  OFFSET " + " ".join(f"{v:.6f}" for v in rest[node]))
        turns = " ".join(f"{axis}rotation" for axis in ORDER)
        head.append(f"{pad}  CHANNELS 6 Xposition Yposition Zposition {turns}")
        if parent is None:
            at, turn = x[:, node], turned[node]
        else:
            back = np.swapaxes(turned[parent], 1, 2)
            at, turn = np.einsum("tij,tj->ti", back, x[:, node] - x[:, parent]), back @ turned[node]
        channels.append(np.column_stack([at, euler_deg(turn)]))
        for child in children[node]:
            add(child, depth + 1)
        if not children[node]:
            head.extend([f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET 0.000000 0.000000 0.000000", f"{pad}  }}"])
        head.append(f"{pad}}}")

    add(used[0], 0)
    head += ["MOTION", f"Frames: {len(t_s)}", f"Frame Time: {(t_s[-1] - t_s[0]) / (len(t_s) - 1):.9g}"]
    table = np.concatenate(channels, axis=1)
    form = " ".join(["%.6f"] * table.shape[1])
    path.write_text("\n".join(head + [form % tuple(row) for row in table.tolist()]) + "\n", encoding="utf-8")


def tree(bones: list[tuple[int, int]], trunk: set[int]) -> dict[int, int | None]:
    """The parent of each marker, the root first, parents before children; parts that no bone joins hang on the root."""
    beside: dict[int, list[int]] = {}
    for a, b in bones:
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    order = sorted(beside, key=lambda node: (node not in trunk, -len(beside[node]), node))
    parents: dict[int, int | None] = {}
    for first in order:
        if first in parents:
            continue
        parents[first] = order[0] if parents else None
        queue = [first]
        while queue:
            node = queue.pop(0)
            for other in beside[node]:
                if other not in parents:
                    parents[other] = node
                    queue.append(other)
    return parents


def rest_offsets(x: Array, parents: dict[int, int | None]) -> dict[int, Array]:
    """From each marker's parent to it at rest: the direction of the first frame, the median length; 0 of the root."""
    out: dict[int, Array] = {}
    for node, parent in parents.items():
        if parent is None:
            out[node] = np.zeros(3)
            continue
        way = x[:, node] - x[:, parent]
        lengths = np.linalg.norm(way, axis=1)
        out[node] = way[0] / max(lengths[0], 1e-12) * np.median(lengths)
    return out


def rotations(
    x: Array, parents: dict[int, int | None], children: dict[int, list[int]], rest: dict[int, Array]
) -> dict[int, Array]:
    """(T, 3, 3) for each marker: what turns the offsets of its children at rest into those of each frame."""
    out: dict[int, Array] = {}
    for node, parent in parents.items():
        before = np.broadcast_to(np.eye(3), (len(x), 3, 3)) if parent is None else out[parent]
        below = children[node]
        if not below:
            out[node] = before
        elif len(below) == 1:
            out[node] = _least(before @ rest[below[0]], x[:, below[0]] - x[:, node]) @ before
        else:
            offsets = np.array([rest[c] for c in below])
            now = np.stack([x[:, c] - x[:, node] for c in below], axis=1)
            # where the directions to the children leave a turn about one line open
            moment = np.einsum("tci,cj->tij", now, offsets) + 1e-6 * float((offsets**2).sum()) * before
            u, _, vt = np.linalg.svd(moment)
            u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
            out[node] = u @ vt
    return out


def _least(a: Array, b: Array) -> Array:
    """(T, 3, 3) least rotations that turn directions (T, 3) into others."""
    a, b = (v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12) for v in (a, b))
    axis, cosine = np.cross(a, b), np.einsum("ti,ti->t", a, b)
    sine = np.linalg.norm(axis, axis=1)
    aside = np.cross(a, np.eye(3)[np.argmin(np.abs(a), axis=1)])  # of opposite directions: any normal
    axis = np.where((sine > 1e-12)[:, None], axis, aside)
    axis = axis / np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-12)
    return Rotation.from_rotvec(axis * np.arctan2(sine, cosine)[:, None]).as_matrix()


def euler_deg(turn: Array) -> Array:
    """(T, 3) angles in degrees of rotations (T, 3, 3), in ``ORDER``; without jumps of a whole turn."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Gimbal lock", UserWarning)  # one of many solutions is a solution
        angles = Rotation.from_matrix(turn).as_euler(ORDER, degrees=True)
    return np.unwrap(angles, period=360.0, axis=0)
