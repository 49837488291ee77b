"""The flights of a cut mission: each from the point where the work resumes to the point where it is left, from a pad to a pad."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True, slots=True)
class Cut:
    """Point where the work is left, and the destination pad; several pads in a row if one is only on the way."""

    point: int
    pads: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Span:
    """One flight: from the point where the work resumes to the point where it is left, from a pad to a pad.

    Attributes
    ----------
    begin : (int, int) or None
        Point at which the work was left, and the pad of take-off; None: the start of the mission.
    end : (int, int) or None
        Point at which the work is left, and the pad of landing; None: the end of the mission. If the point is that of `begin`,
        the flight only leads from pad to pad.
    """

    begin: tuple[int, int] | None
    end: tuple[int, int] | None

    @property
    def only_moves(self) -> bool:
        """Whether no work is done on it."""
        return self.begin is not None and self.end is not None and self.begin[0] == self.end[0]


Done = tuple[int, float]
"""Progress of the work: the step that leads there, and the share of its leg; they compare in this order."""


def spans_of(cuts: Sequence[Cut], begin: tuple[int, int] | None = None) -> list[Span]:
    """Return the flights that result from cuts of the work, from its start or from a point and a pad."""
    found: list[Span] = []
    before = begin
    for cut in cuts:
        for pad in cut.pads:
            found.append(Span(before, (cut.point, pad)))
            before = (cut.point, pad)
    found.append(Span(before, None))
    return found
