"""Words that need more than typer's parsing: former names, options whose value may be omitted, and what was typed wrongly."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import Fault

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

RENAMED = {
    "plan": {"--truth": "--actual-wind"},
    "compare": {"--truth": "--actual-wind"},
    "wind": {"--truth": "--actual-wind"},
    "sim": {"--wind-truth": "--wind", "--for": "--duration"},
    "watch": {"--for": "--duration"},
    "demo": {"--proving-flight": "--calibration-flight"},
    "bench": {"--keep": "--resume", "--out": "--output"},
}
"""New name of each option by command and former name, which keeps working, hidden, for one release."""
UNNAMED = {"weather": "show"}
"""Command of a group that is meant where none is named: ``weather FILE`` is ``weather show FILE``."""
BARE: Mapping[str, Mapping[str, str]] = {
    "sim": {"--jitter": "0.01", "--duplicate": "0.02", "--reorder": "0.02"},
    "replay": {"--aboard": "0"},
}
"""What an option of a command means where it stands bare, ``--jitter`` for ``--jitter 0.01``: typer has no such options."""

_NUMBERS = {"float_parsing": "is not a number", "int_parsing": "is not a whole number"}
_ENDS = {"ge": "or more", "le": "or less", "gt": "is too little", "lt": "is too much"}


def with_new_names(arguments: list[str]) -> list[str]:
    """Return the arguments of a command line with former names of options replaced; what follows ``--`` is left alone."""
    names = RENAMED.get(arguments[0], {}) if arguments else {}
    end = arguments.index("--") if "--" in arguments else len(arguments)
    return [_new(one, names) for one in arguments[:end]] + arguments[end:]


def with_command(arguments: list[str], groups: Mapping[str, Collection[str]]) -> list[str]:
    """Return a command line with the command of its group that is meant where none is named; `groups`: commands of each."""
    meant = UNNAMED.get(arguments[0]) if len(arguments) > 1 else None
    if meant is None or arguments[1] in (*groups[arguments[0]], "--help", "-h"):
        return arguments
    return [arguments[0], meant, *arguments[1:]]


def _new(argument: str, names: dict[str, str]) -> str:
    name, equals, value = argument.partition("=")
    return names.get(name, name) + equals + value


def fill(arguments: Sequence[str], bare: Mapping[str, str]) -> list[str]:
    """Give every bare option its value from `bare`: what follows it is not a number."""
    filled: list[str] = []
    for place, word in enumerate(arguments):
        if word == "--":
            return [*filled, *arguments[place:]]
        following = arguments[place + 1] if place + 1 < len(arguments) else ""
        filled.append(f"{word}={bare[word]}" if word in bare and not _number(following) else word)
    return filled


def _number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def usage_words(error: Any) -> str:
    """Describe a usage error of typer; a value that it could not convert is named with its option, and with what is allowed."""
    cause, parameter = error.__context__, getattr(error, "param", None)
    if parameter is None or not hasattr(cause, "errors"):
        return " ".join(error.format_message().split())
    found = cause.errors()[0]
    dashed = [one for one in parameter.opts if one.startswith("--")]
    option, value, context = (dashed or [parameter.name])[0], found.get("input"), found.get("ctx", {})
    end = next((f"{context[key]:g} {words}" for key, words in _ENDS.items() if key in context), None)
    if end is not None:
        return str(Fault("out of range", field=option, value=value, remedy=end))
    if found["type"] in _NUMBERS:
        return str(Fault(_NUMBERS[found["type"]], field=option, value=value))
    _, choice, known = found["msg"].partition(" is not one of ")
    if choice:
        return str(Fault("is not known", field=option, value=value, remedy=f"one of {known.rstrip('.')}"))
    return str(Fault(found["msg"], field=option, value=value))
