"""Settings of motion models as the JSON of a model file has them."""

from dataclasses import fields, replace
from typing import Any, Literal, get_args, get_origin, get_type_hints

from mocap.errors import FormatError
from mocap.filters.models.base import TrajectoryModel
from mocap.filters.models.registry import MODELS
from mocap.schema import LARGEST, Entry, checked


def written(model: TrajectoryModel) -> dict[str, Any]:
    """A model as JSON: its name and its settings.

    Raises:
        KeyError: it is not in ``MODELS``.
    """
    names = {kind: name for name, kind in MODELS.items()}
    settings = {f.name: getattr(model, f.name) for f in fields(model)}
    return {"model": names[type(model)], **{key: _written(value) for key, value in settings.items()}}


def _written(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_written(one) for one in value]
    return written(value) if isinstance(value, TrajectoryModel) else value


def read(settings: Any, *, again: str = "learn it again") -> TrajectoryModel:
    """A model as ``written`` wrote it.

    Args:
        settings: As JSON has them.
        again: What to do where they are not such, for messages.

    Raises:
        FormatError: it has another name, or other settings than its class declares.
    """
    name = settings.get("model") if isinstance(settings, dict) else settings
    if not isinstance(name, str) or name not in MODELS:
        raise FormatError(f"models: {name!r} is none of {', '.join(MODELS)}: {again}")
    declared = get_type_hints(MODELS[name])
    kinds = {f.name: declared[f.name] for f in fields(MODELS[name])}
    if settings.keys() != {"model", *kinds}:
        odd = min(settings.keys() ^ {"model", *kinds})
        raise FormatError(f"models: {name} has other settings than this version ({odd}): {again}")
    values: dict[str, Any] = {}
    for key, kind in kinds.items():
        if isinstance(kind, type) and issubclass(kind, TrajectoryModel):
            values[key] = read(settings[key], again=again)
            if not isinstance(values[key], kind):
                raise FormatError(f"models: {name}.{key} is another model: {again}")
        else:
            found = checked(f"models: {name}", settings, {key: _entry(kind)}, again=again)[key].tolist()
            values[key] = tuple(found) if isinstance(found, list) else found
    return MODELS[name](**values)


def _entry(kind: Any) -> Entry:
    """What a setting must be by its annotation: choices; a number, which is at least 0; or several, of any sign."""
    if get_origin(kind) is tuple:
        one = _entry(get_args(kind)[0])
        return replace(one, shape=(None,), least=1 if one.kind == "i" else -LARGEST)
    if get_origin(kind) is Literal:
        return Entry(kind="s", words=get_args(kind))
    return Entry(kind={bool: "b", int: "i", float: "f"}[kind], least=0)
