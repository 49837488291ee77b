"""Former names of options, which keep working, hidden, for one release."""

from __future__ import annotations

RENAMED = {
    "plan": {"--truth": "--actual-wind"},
    "compare": {"--truth": "--actual-wind"},
    "wind": {"--truth": "--actual-wind"},
    "sim": {"--wind-truth": "--wind", "--for": "--duration"},
    "watch": {"--for": "--duration"},
    "demo": {"--proving-flight": "--calibration-flight"},
    "bench": {"--keep": "--resume", "--out": "--output"},
}
"""New name of each option by command and former name."""


def with_new_names(arguments: list[str]) -> list[str]:
    """Return the arguments of a command line with former names of options replaced; what follows ``--`` is left alone."""
    names = RENAMED.get(arguments[0], {}) if arguments else {}
    end = arguments.index("--") if "--" in arguments else len(arguments)
    return [_new(one, names) for one in arguments[:end]] + arguments[end:]


def _new(argument: str, names: dict[str, str]) -> str:
    name, equals, value = argument.partition("=")
    return names.get(name, name) + equals + value
