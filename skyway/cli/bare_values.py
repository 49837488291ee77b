"""Options whose value may be omitted: ``--jitter``, ``--jitter 0.02``.

typer has no such options; so the value is put in before the command line is read.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

BARE: Mapping[str, Mapping[str, str]] = {"sim": {"--jitter": "0.01", "--duplicate": "0.02", "--reorder": "0.02"}}
"""What an option of a command means where it stands bare."""


def fill(arguments: Sequence[str], bare: Mapping[str, str]) -> list[str]:
    """Give every bare option its value: what follows it is not a number.

    Parameters
    ----------
    bare : mapping
        Options that take a number, with the value of the bare option.
    """
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
