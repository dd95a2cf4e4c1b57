"""Poses of people and animals as JSON, a file a frame: OpenPose, and RTMPose and MediaPipe as Pose2Sim writes them.

A folder holds the frames of one camera, or a folder for each camera. OpenPose's layout (CMU Perceptual Computing Lab,
``doc/02_output.md``) has ``people[i].pose_keypoints_2d = x1, y1, c1, x2, ...``, 0 where nothing was found; MMPose's own
has ``instances[i].keypoints`` and ``keypoint_scores`` (also under ``instance_info``, a list of frames). AlphaPose
writes, as COCO's results, a list of people with ``image_id`` and ``keypoints = x1, y1, c1, x2, ...``.
"""

import json
import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.documents import damaged, from_json, regular_bytes
from mocap.errors import FormatError
from mocap.io.apart import check_bytes
from mocap.io.contents import FileContents, pixel_recording
from mocap.io.format import Format, Head, Hints, file_format
from mocap.io.lines import MOST_FRAMES, image_numbers
from mocap.schema import Entry, Schema, checked

_COCO = (
    "nose left_eye right_eye left_ear right_ear left_shoulder right_shoulder left_elbow right_elbow left_wrist "
    "right_wrist left_hip right_hip left_knee right_knee left_ankle right_ankle"
)
_NAMES = {
    17: _COCO,
    18: "nose neck right_shoulder right_elbow right_wrist left_shoulder left_elbow left_wrist right_hip right_knee "
    "right_ankle left_hip left_knee left_ankle right_eye left_eye right_ear left_ear",
    25: "nose neck right_shoulder right_elbow right_wrist left_shoulder left_elbow left_wrist mid_hip right_hip "
    "right_knee right_ankle left_hip left_knee left_ankle right_eye left_eye right_ear left_ear left_big_toe "
    "left_small_toe left_heel right_big_toe right_small_toe right_heel",
    26: f"{_COCO} head neck hip left_big_toe right_big_toe left_small_toe right_small_toe left_heel right_heel",
    33: "nose left_eye_inner left_eye left_eye_outer right_eye_inner right_eye right_eye_outer left_ear right_ear "
    "mouth_left mouth_right left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist left_pinky "
    "right_pinky left_index right_index left_thumb right_thumb left_hip right_hip left_knee right_knee left_ankle "
    "right_ankle left_heel right_heel left_foot_index right_foot_index",
}
"""Names of keypoints by their number: COCO, OpenPose's COCO and BODY_25, HALPE_26, MediaPipe's BlazePose."""


def names_of(count: int) -> tuple[str, ...]:
    """Names of ``count`` keypoints: those of the body model that has so many, else numbers."""
    return tuple(_NAMES[count].split()) if count in _NAMES else tuple(f"keypoint{k + 1}" for k in range(count))


def _people(path: Path, frame: Any) -> list[Array]:
    """(K, 3) pixels and likelihoods of each person in a frame."""
    found = []
    advice = "expected people[].pose_keypoints_2d, or instances[].keypoints with keypoint_scores"
    with damaged(f"{path.name}: no poses as OpenPose or MMPose write them", advice):
        if isinstance(frame, dict) and "people" in frame:
            for person in frame["people"]:
                flat = [*person["pose_keypoints_2d"]]
                for part in ("hand_left_keypoints_2d", "hand_right_keypoints_2d", "face_keypoints_2d"):
                    flat += person.get(part) or []
                found.append(np.array(flat, dtype=float).reshape(-1, 3))
        else:
            instances = frame.get("instances", []) if isinstance(frame, dict) else frame
            for one in instances:
                flat = np.array(one["keypoints"], dtype=float)
                if flat.ndim == 1 and "keypoint_scores" not in one:  # x1, y1, c1, x2, ..., as COCO has them
                    found.append(flat.reshape(-1, 3))
                    continue
                uv = flat.reshape(-1, 2)
                score = np.array(one.get("keypoint_scores", np.ones(len(uv))), dtype=float).reshape(-1, 1)
                found.append(np.concatenate([uv, score], axis=1))
    for person in found:
        gone = (person[:, :2] == 0).all(axis=1) | ~np.isfinite(person).all(axis=1) | (person[:, 2] <= 0)
        person[gone] = np.nan
    return [person for person in found if len(person) and np.isfinite(person).any()]


_FRAME: Schema = {"frame_id": Entry(kind="i", least=0, most=MOST_FRAMES)}


def _frames(files: Sequence[Path]) -> dict[int, list[Array]]:
    """People by frame number: the last digits of a file's name before its ending, or the list inside one file."""
    out: dict[int, list[Array]] = {}
    for position, file in enumerate(files):
        # a day of one person's 133 points at 30 Hz in short numbers
        table = from_json(regular_bytes(file, most=2**30), file.name, finite=False)
        if isinstance(table, list) and table and all(isinstance(one, dict) and "image_id" in one for one in table):
            people: dict[str, list[Any]] = {}
            for one in table:
                people.setdefault(str(one["image_id"]), []).append(one)
            told_by = image_numbers(list(people)) or range(position, position + len(people))
            out |= {number: _people(file, own) for number, own in zip(told_by, people.values(), strict=True)}
            continue
        inside = table.get("instance_info") if isinstance(table, dict) else None
        inside = inside or (table if isinstance(table, list) and table and "instances" in str(table[0])[:400] else None)
        if inside is not None:
            for k, frame in enumerate(inside):
                number = frame.get("frame_id", k + 1) if isinstance(frame, dict) else k + 1
                entry = checked(file.name, {"frame_id": number}, _FRAME, again="write it again")
                out[int(entry["frame_id"])] = _people(file, frame)
            continue
        digits = re.findall(r"\d+", file.stem.removesuffix("_keypoints"))
        number = int(digits[-1]) if digits else position
        if number in out:
            raise FormatError(f"{file.name}: two files have the frame number {number}: a folder holds one camera")
        out[number] = _people(file, table)
    return out


def _followed(frames: dict[int, list[Array]]) -> tuple[dict[int, Array], int]:
    """One person through the frames: the one seen best at first, then the one nearest to the last place."""
    out: dict[int, Array] = {}
    last: Array | None = None
    most = 0
    for number in sorted(frames):
        people = frames[number]
        most = max(most, len(people))
        if not people:
            continue
        if last is None:
            chosen = max(people, key=lambda p: float(np.nansum(p[:, 2])))
        else:
            before = last

            def away(person: Array, before: Array = before) -> float:
                off = np.linalg.norm(person[: len(before), :2] - before[: len(person), :2], axis=1)
                return float(np.nanmean(off)) if np.isfinite(off).any() else np.inf

            chosen = min(people, key=away)
        out[number] = last = chosen
    return out, most


def read_folder(path: Path) -> FileContents:
    """Pixels and likelihoods of a folder of JSON files of one camera, of a folder of such folders, or of one file.

    Raises:
        FormatError: it holds no poses.
    """
    if path.is_dir():
        views = {d.name: sorted(d.glob("*.json")) for d in sorted(path.iterdir()) if d.is_dir()}
        views = {name: files for name, files in views.items() if files} or {path.name: sorted(path.glob("*.json"))}
    else:
        views = {path.stem: [path]}
    if not any(views.values()):
        inside = sorted(p.name for p in path.iterdir())
        more = f", ... ({len(inside)} in all)" if len(inside) > 3 else ""
        content = f" without poses (JSON, one file per frame); in it: {', '.join(inside[:3])}{more}"
        content = content if inside else " with nothing in it"
        raise FormatError(f"{path.resolve().name}: is a folder{content}: give a file")
    tracks, most, frames = {}, 0, set[int]()
    for name, files in views.items():
        people = _frames(files)
        frames |= people.keys()  # also those without a person
        tracks[name], crowd = _followed(people)
        most = max(most, crowd)
    numbers = np.array(sorted(frames), dtype=np.int64)
    counts = {len(p) for found in tracks.values() for p in found.values()}
    if not counts:
        raise FormatError(
            f"{path.resolve().name}: a folder is read as JSON files with poses, and no person is found in them: "
            "give the file of one recording, or a folder with the poses of each frame"
        )
    if len(counts) > 1:
        raise FormatError(f"{path.name}: frames have {min(counts)} to {max(counts)} keypoints: use one model")
    (count,) = counts
    uv = np.full((len(tracks), len(numbers), count, 3), np.nan)
    for c, found in enumerate(tracks.values()):
        for number, person in found.items():
            uv[c, np.searchsorted(numbers, number)] = person
    chosen = f"up to {most} people in a frame: one is followed, from the one seen best in the first frame"
    notes = [chosen] if most > 1 else []
    return pixel_recording(
        path,
        "pose-json",
        names=names_of(count),
        cameras=tuple(tracks),
        uv_px=uv[..., :2],
        frames=numbers,
        first=int(numbers[0]),
        pixel_origin="upper-left",
        score=uv[..., 2],
        findings=tuple(notes),
    )


def _is_poses(head: Head) -> bool:
    text = head.start[:4000].decode("utf-8", "replace")
    return text.lstrip()[:1] in ("{", "[") and (
        "pose_keypoints_2d" in text or '"keypoint' in text or '"people"' in text
    )


def _is_coco(head: Head) -> bool:
    text = "".join(head.lines).lstrip()
    if not text.startswith("{") or not re.search(r'"(images|annotations)"\s*:', text):
        return False
    return '"keypoints"' in head.path.read_text(encoding="utf-8", errors="replace")  # the categories may come last


@file_format("coco-keypoints", "keypoints of COCO (JSON)", _is_coco)
def _read_coco(path: Path, _hints: Hints) -> FileContents:
    """Pixels; a camera for each folder of images, an animal for each ``track_id`` (else by its place in the image).

    Frames have the number that ends the image's name where these differ, else they are counted in their order.

    Raises:
        FormatError: a part is missing or has another shape; the message names the annotation.
    """
    with damaged(f"{path.name}: not COCO's images, categories, annotations", "export it again"):
        whole = json.loads(path.read_text(encoding="utf-8"))
        images = {image["id"]: PurePosixPath(str(image["file_name"]).replace("\\", "/")) for image in whole["images"]}
        kinds = {kind["id"]: kind for kind in whole["categories"] if kind.get("keypoints")}
        marks = [mark for mark in whole["annotations"] if mark.get("keypoints")]
    if not images or not kinds or not marks:
        raise FormatError(f"{path.name}: contains no images with annotated keypoints: export it again")
    frames = _image_frames(images)
    folders = sorted({str(name.parent) for name in images.values()})
    samples, scores = {}, {}
    places: Counter[Any] = Counter()
    for mark in marks:
        try:
            image, kind = mark["image_id"], kinds[mark["category_id"]]
            values = np.asarray(mark["keypoints"], dtype=np.float64).reshape(len(kind["keypoints"]), 3)
            at = (folders.index(str(images[image].parent)), frames[image])
        except (ValueError, TypeError, KeyError):
            raise FormatError(
                f"{path.name}: annotation {mark.get('id')} has no image, or not x, y and visibility of each keypoint"
            ) from None
        track = mark.get("track_id", (mark.get("attributes") or {}).get("track_id"))
        animal = (str(kind.get("name", "animal")), places[image, mark["category_id"]] if track is None else track)
        places[image, mark["category_id"]] += 1
        if (*at, animal) in samples:
            raise FormatError(f"{path.name}: annotation {mark.get('id')}: track {track} is in its image twice")
        samples[(*at, animal)] = np.where(values[:, 2:] > 0, values[:, :2], np.nan)
        scores[(*at, animal)] = mark.get("score", np.nan)
    return _recording(
        path, samples, scores, folders, {str(k.get("name", "animal")): k["keypoints"] for k in kinds.values()}
    )


def _image_frames(images: dict[Any, PurePosixPath]) -> dict[Any, int]:
    by_folder: dict[PurePosixPath, list[Any]] = defaultdict(list)
    for image, name in images.items():
        by_folder[name.parent].append(image)
    found: dict[Any, int] = {}
    for own in by_folder.values():
        numbers = image_numbers([images[image].name for image in own])
        if numbers is None or max(numbers) - min(numbers) >= 100 * len(own):
            numbers = range(len(own))
        found |= dict(zip(own, numbers, strict=True))
    return found


def _recording(
    path: Path, samples: dict[Any, Any], scores: dict[Any, Any], folders: list[str], names: dict[str, list[str]]
) -> FileContents:
    first, last = (end(frame for _, frame, _ in samples) for end in (min, max))
    check_bytes(path, 24 * (last - first + 1) * len(folders), "all frames up to its last image")
    animals = sorted({animal for *_, animal in samples}, key=str)
    markers = [(animal, str(name)) for animal in animals for name in names[animal[0]]]
    starts = dict(zip(animals, np.cumsum([0, *(len(names[animal[0]]) for animal in animals)]), strict=False))
    uv = np.full((len(folders), last - first + 1, len(markers), 2), np.nan)
    score = np.full(uv.shape[:3], np.nan)
    for (camera, frame, animal), values in samples.items():
        own = slice(starts[animal], starts[animal] + len(values))
        uv[camera, frame - first, own], score[camera, frame - first, own] = values, scores[camera, frame, animal]
    single = len(animals) == 1
    label = {animal: animal[0] if single else f"{animal[0]}{animal[1]}" for animal in animals}
    return pixel_recording(
        path,
        "coco-keypoints",
        names=[name if single else f"{label[animal]}_{name}" for animal, name in markers],
        cameras=[path.stem] if len(folders) == 1 else [PurePosixPath(folder).name or "cam" for folder in folders],
        uv_px=uv,
        first=first,
        pixel_origin="upper-left",
        animals=() if single else tuple((label[animal], name) for animal, name in markers),
        score=None if np.isnan(score).all() else score,
    )


POSE_JSON = Format(
    name="pose-json",
    title="poses of OpenPose, RTMPose or MediaPipe (JSON, one file per frame)",
    knows=_is_poses,
    read=lambda path, _: read_folder(path),
    signs="json people pose_keypoints_2d keypoints keypoint_scores",
)
