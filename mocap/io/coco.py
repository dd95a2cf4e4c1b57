"""Keypoints as COCO annotates them (Lin et al. 2014): one JSON of images, categories and annotations."""

import json
import re
from collections import Counter, defaultdict
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from mocap.documents import one_line
from mocap.errors import FormatError
from mocap.io.bounds import check_bytes
from mocap.io.contents import FileContents, pixel_recording
from mocap.io.format import Format, Hints
from mocap.io.head import Head
from mocap.io.lines import image_numbers


def _is_coco(head: Head) -> bool:
    text = "".join(head.lines).lstrip()
    return (
        text.startswith("{") and bool(re.search(r'"(images|annotations)"\s*:', text)) and '"keypoints"' in _whole(head)
    )


def _whole(head: Head) -> str:
    """The text of the file, of which the categories may come last."""
    return head.path.read_text(encoding="utf-8", errors="replace")


def _read(path: Path, _hints: Hints) -> FileContents:
    """Pixels; a camera for each folder of images, an animal for each ``track_id`` (else by its place in the image).

    Frames have the number that ends the image's name where these differ, else they are counted in their order.

    Raises:
        FormatError: a part is missing or has another shape; the message names the annotation.
    """
    try:
        whole = json.loads(path.read_text(encoding="utf-8"))
        images = {image["id"]: PurePosixPath(str(image["file_name"]).replace("\\", "/")) for image in whole["images"]}
        kinds = {kind["id"]: kind for kind in whole["categories"] if kind.get("keypoints")}
        marks = [mark for mark in whole["annotations"] if mark.get("keypoints")]
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise FormatError(f"{path.name}: not COCO's images, categories, annotations ({one_line(error)})") from None
    if not images or not kinds or not marks:
        raise FormatError(f"{path.name}: contains no images with annotated keypoints: export it again")
    frames = _frames(images)
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


def _frames(images: dict[Any, PurePosixPath]) -> dict[Any, int]:
    """The number of each image's frame."""
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


FORMATS = (Format(name="coco-keypoints", title="keypoints of COCO (JSON)", knows=_is_coco, read=_read),)
