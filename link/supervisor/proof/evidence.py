"""Evidence of a delivery, and the verdict from all of it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, tzinfo
from enum import StrEnum
from typing import TYPE_CHECKING

from skyway.models.base.formatting import zone_clock
from skyway.models.base.units import from_posix

if TYPE_CHECKING:
    from skyway.link.supervisor.proof.weighing import Weight

ABOARD, SURE_SIGMAS, WEIGHABLE = 0.3, 1.0, 0.25
"""Share of the package above which it counts as on board; a weight within that number of standard deviations of it gives no verdict, nor does
one whose standard deviation is above the last."""

GONE, GONE_SIGMAS = 0.6, 2.0
"""A share on board before the release below the first, by the second number of standard deviations, means that the
package was lost on the way."""
STILL = 0.5
"""A share on board before the release above this, by one standard deviation, means that the power fell in a gust,
not with the package."""


class Verdict(StrEnum):
    """Verdict on the package."""

    DELIVERED = "delivered"
    NOT_DELIVERED = "not delivered"
    UNSURE = "unsure"


@dataclass(frozen=True, slots=True)
class Evidence:
    """Evidence so far; None if unknown."""

    acknowledged: bool | None = None
    """The gripper, or the person, reported the release."""
    by_person: bool = False
    """A person took the package off."""
    how: str = ""
    """Observation of a winch or a payload place, for a release in the air."""
    lost_s: float | None = None
    """Time at which power fell as if the package was lost on the way, POSIX seconds."""
    before: Weight | None = None
    """Share on board just before the release: in the last seconds of slow descent, or hover."""
    weight: Weight | None = None
    """Share on board after the next take-off."""
    package_kg: float = 0.0

    @property
    def lost(self) -> bool:
        """Whether the package was lost on the way: a weighing before the release overrides a fall of the power in flight."""
        b = self.before
        if b is None:
            return self.lost_s is not None
        light, heavy = b.share + GONE_SIGMAS * b.sigma < GONE, b.share - b.sigma > STILL
        return light or (self.lost_s is not None and not heavy)

    @property
    def tried(self) -> bool:
        """Whether a release was tried."""
        return self.acknowledged is not None or bool(self.how)


def judge(e: Evidence, zone: tzinfo = UTC) -> tuple[Verdict, str]:
    """Return the verdict, and its reason, with times of a zone.

    A weighing overrides reports: grippers acknowledge without opening. A package that
    was lost on the way was not delivered, whatever the gripper reports.
    """
    if e.lost and e.lost_s is not None:
        at = f"at {_clock(e.lost_s, zone)}"
        return (
            Verdict.NOT_DELIVERED,
            f"the package was lost on the way: the power fell suddenly in steady flight, {at}",
        )
    if e.lost and e.before is not None:
        figure = _weighed_text(e.before, e.package_kg)
        since = "" if e.before.since_s is None else f", since about {_clock(e.before.since_s, zone)}"
        why = f"the package was lost on the way: {figure} on board by the power before the release{since}"
        return Verdict.NOT_DELIVERED, why
    said = e.how or ("a person took it off" if e.by_person else "the release was acknowledged")
    if e.acknowledged is False:
        return Verdict.NOT_DELIVERED, e.how or "the release was not acknowledged"
    w = e.weight
    if w is None:
        if e.acknowledged:
            why = "not weighed" if e.how else "not weighed, since the drone has not taken off again"
            return Verdict.DELIVERED, f"{said}; {why}"
        return Verdict.UNSURE, f"{e.how or 'no acknowledgement'}; not weighed"
    figure = _weighed_text(w, e.package_kg)
    if w.sigma > WEIGHABLE or abs(w.share - ABOARD) < SURE_SIGMAS * w.sigma:
        why = "too light to be weighed" if w.sigma > WEIGHABLE else "weighed"
        return Verdict.UNSURE, f"{said}, and the package was {why}: {figure} appear to be on board"
    if w.share > ABOARD:
        part = "" if w.share > 0.75 else " in part"
        return (
            Verdict.NOT_DELIVERED,
            f"{said}, but the package is{part} still on board: {figure} by the power after take-off",
        )
    return Verdict.DELIVERED, f"{said}, and the drone is lighter: {figure} on board by the power after take-off"


def _clock(at_s: float, zone: tzinfo) -> str:
    return zone_clock(from_posix(at_s), zone)


def _weighed_text(weight: Weight, package_kg: float) -> str:
    return f"{max(weight.share, 0.0) * package_kg:.2f} ± {weight.sigma * package_kg:.2f} of {package_kg:g} kg"
