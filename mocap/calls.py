"""Calls of the public functions: what is wrong with an argument, and what to write instead."""

from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from functools import wraps
from inspect import Parameter, Signature, signature
from numbers import Integral
from os import PathLike
from typing import Any

from mocap.errors import MocapError

_PATH = (str, PathLike)
_KINDS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "unit": (lambda x: isinstance(x, str), "a text: m, mm, cm, in or ft"),
    "name": (lambda x: isinstance(x, str), "a text: what the recording is called"),
    "seed": (lambda x: isinstance(x, Integral) and not isinstance(x, bool), "a whole number"),
    "progress": (callable, "a function that is called with how far it is, such as print"),
    "folder": (lambda x: isinstance(x, _PATH), "the folder of a result"),
    "out": (lambda x: isinstance(x, _PATH), "a folder to write into"),
    "path": (lambda x: isinstance(x, _PATH), "a file"),
    "sources": (
        lambda x: isinstance(x, _PATH) or hasattr(x, "__iter__"),
        "a folder, a pattern or a manifest, or several",
    ),
    "names": (lambda x: isinstance(x, _PATH) or hasattr(x, "__iter__"), "a list of texts"),
    "cameras": (
        lambda x: isinstance(x, _PATH) or hasattr(x, "__iter__"),
        "a calibration file, an array or Camera objects",
    ),
}
"""What the arguments of these names take, of whichever function; None is the function's own where it is the default."""

_SOURCES = ("read", "from_arrays", "from_pixels")
"""The functions that make a recording."""


def with_advice(function: Callable[..., Any], others: Mapping[str, Callable[[], Callable[..., Any]]]) -> Any:
    """The function, whose wrong calls are told in one line each, with what to do.

    Args:
        function: A public function.
        others: The public functions by name: of what an argument belongs to.

    Raises:
        TypeError: by the call: an argument is missing, or none of its own.
        MocapError: by the call: an argument is of another kind.
    """
    takes = signature(function)

    @wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        try:
            bound = takes.bind(*arguments, **named)
        except TypeError as error:
            raise TypeError(_advice(function.__name__, takes, arguments, named, others, str(error))) from None
        for name, given in bound.arguments.items():
            fits, expected = _KINDS.get(name, (None, ""))
            usual = given is None and takes.parameters[name].default is None
            if fits is not None and not usual and not fits(given):
                raise MocapError(f"`{name}` is {given!r:.60}, expected {expected}")
        return function(*arguments, **named)

    return call


def _advice(
    verb: str,
    takes: Signature,
    arguments: Sequence[Any],
    named: Mapping[str, Any],
    others: Mapping[str, Callable[[], Callable[..., Any]]],
    problem: str,
) -> str:
    own = [name for name, one in takes.parameters.items() if one.kind is not Parameter.VAR_KEYWORD]
    first = [name for name, one in takes.parameters.items() if one.kind is Parameter.POSITIONAL_OR_KEYWORD]
    call = f"mocap.{verb}({', '.join(name if name in first else f'{name}=' for name in own)})"
    strange = next((name for name in named if name not in own), None)
    if strange is None:
        return f"mocap.{verb}: {problem}: expected {call}"
    like = get_close_matches(strange, own, n=1)
    if like:
        return f"mocap.{verb} has no argument `{strange}`; did you mean `{like[0]}`?"
    belongs = [one for one in _SOURCES if strange in signature(others[one]()).parameters]
    if verb in _SOURCES or not belongs:
        return f"mocap.{verb} has no argument `{strange}`: expected {call}"
    from_file = bool(arguments) and isinstance(arguments[0], _PATH)
    source = (
        f"mocap.read({str(arguments[0])!r}, {strange}=...)" if from_file else f"mocap.from_arrays(xyz, {strange}=...)"
    )
    call = f"mocap.{verb}([{source}, ...])" if verb == "learn" else f"mocap.{verb}({source})"
    return f"mocap.{verb} has no argument `{strange}`, which mocap.{', mocap.'.join(belongs)} take: {call}"
