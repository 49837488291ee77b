"""Options whose value may be omitted: ``--jitter``, ``--jitter 0.02``.

typer has no such options; so the value is put in before the command line is read.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from typer.core import TyperCommand

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


def fill(arguments: Sequence[str], bare: Mapping[str, str]) -> list[str]:
    """Give every bare option its value: what follows it is not a number.

    Parameters
    ----------
    arguments : sequence of str
        As typed.
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


class BareValueCommand(TyperCommand):
    """A command of which some options may stand bare.

    Attributes
    ----------
    BARE : mapping
        Those options, with the value of the bare option.
    """

    BARE: ClassVar[Mapping[str, str]] = {}

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # typer's own Context, or click's in older releases
        """Read the command line with the values put in."""
        return super().parse_args(ctx, fill(args, self.BARE))
