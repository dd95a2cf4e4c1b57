"""The model that a batch learns from all its trials before it tracks them."""

import hashlib
import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from mocap.batches.known import Options, key_of
from mocap.batches.trial import Trial
from mocap.cameras.origin import OriginError
from mocap.documents import from_json, regular_bytes
from mocap.errors import FormatError, MocapError
from mocap.io.output import result_file
from mocap.pipeline.cleaning import clean
from mocap.pipeline.learning import Model, learn_from
from mocap.pipeline.recording import Recording
from mocap.schema import Entry, checked

MODEL, OF = "model.npz", "model.json"
"""The model, and what it was learned from."""


def model_key(trials: Sequence[Trial], seed: int) -> str:
    """SHA-256 of all that a model of these trials depends on; a trial whose files are missing counts by its name."""
    keys = []
    for trial in trials:
        try:
            keys.append(key_of(trial, Options(seed=seed)))
        except OSError:
            keys.append(trial.name)
    return hashlib.sha256("\n".join(keys).encode()).hexdigest()


def is_learned(trials: Sequence[Trial], seed: int, out: Path) -> bool:
    """Whether the model of these trials, as they are now, has been written."""
    try:
        found = checked(OF, from_json(regular_bytes(out / OF), OF), {"key": Entry(kind="s")}, again="")
    except (OSError, FormatError):
        return False
    return (out / MODEL).is_file() and found["key"][()] == model_key(trials, seed)


def learn_model(trials: Sequence[Trial], out: Path, seed: int) -> None:
    """Learn a model from all trials that can be read, and write it beside their results.

    ``model.json`` tells which trials it is of, and why others are not among them.

    Raises:
        MocapError: none can be read, or those that can have nothing in common.
    """
    used: list[str] = []
    left_out: dict[str, str] = {}
    try:
        model = Model(learn_from(_sources(trials, used, left_out), seed=seed))
    except MocapError as error:
        if not used:
            first = next(iter(left_out.items()))
            raise MocapError(f"no model can be learned: no trial can be read, as {first[0]}: {first[1]}") from None
        raise MocapError(
            f"no model can be learned from these {len(used)} trials together: {error}: make batches of trials that "
            "are alike, or give `model` auto"
        ) from None
    told = {"key": model_key(trials, seed), "learned_from": used, "left_out": left_out, "scores": model.scores}
    with result_file(out / MODEL, replace=True) as file:
        model.write(file)
        text = json.dumps(told, indent=1, sort_keys=True)
        file.with_name(OF).write_text(text + "\n", encoding="utf-8")


def _sources(trials: Sequence[Trial], used: list[str], left_out: dict[str, str]) -> Iterator[Recording]:
    """Those that can be read, one after the other; their names are added to ``used``, reasons to ``left_out``."""
    for trial in trials:
        try:
            recording = trial.recording().without_needless_calibration()
            with suppress(OriginError):  # the others may tell which corner pixels are counted from
                recording = clean(recording)
            used.append(trial.name)
        except MocapError as error:
            left_out[trial.name] = " ".join(str(error).split())
            continue
        yield recording
