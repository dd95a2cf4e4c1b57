"""Options that belong together are one dataclass, which a command takes as one argument."""

import dataclasses
import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any


def with_records(command: Callable[..., None]) -> Callable[..., None]:
    """A command for typer, in which each field of a dataclass that the command takes is an option of its own.

    Args:
        command: Annotated with types, not with their names as text; the fields of its dataclasses are annotated as
            options of typer are.

    Raises:
        TypeError: two of its records, or a record and an argument, have a name in common.
    """
    parameters: dict[str, inspect.Parameter] = {}
    records: dict[str, type] = {}
    for name, parameter in inspect.signature(command).parameters.items():
        found = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)]
        if dataclasses.is_dataclass(parameter.annotation):
            records[name] = parameter.annotation  # type: ignore[assignment]
            found = [_parameter(field) for field in dataclasses.fields(parameter.annotation)]
        for one in found:
            if one.name in parameters:
                raise TypeError(f"{command.__name__} has two options {one.name}")
            parameters[one.name] = one

    @wraps(command)
    def called(**given: Any) -> None:
        for name, record in records.items():
            given[name] = record(**{field.name: given.pop(field.name) for field in dataclasses.fields(record)})
        command(**given)

    called.__signature__ = inspect.Signature(list(parameters.values()))  # type: ignore[attr-defined]
    called.__annotations__ = {name: one.annotation for name, one in parameters.items()}
    del called.__wrapped__  # type: ignore[attr-defined]
    return called


def _parameter(field: dataclasses.Field) -> inspect.Parameter:
    default = inspect.Parameter.empty if field.default is dataclasses.MISSING else field.default
    return inspect.Parameter(field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=field.type)
