"""Reasons for replanning, as stated with a changed promise."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass
class Reasons:
    """Reasons for a replan: sentences; those that concern one drone by its id."""

    general: list[str] = field(default_factory=list)
    of_drone: dict[str, str] = field(default_factory=dict)
    delays_s: dict[str, float] = field(default_factory=dict)
    """By the id of a drone that is late, the part of its delay that no plan has counted yet, s."""

    def __bool__(self) -> bool:
        return bool(self.general or self.of_drone)

    def why(self, drones: Sequence[str]) -> str:
        """Return the reason for changing the promise of some drones."""
        own = [self.of_drone[one] for one in dict.fromkeys(drones) if one in self.of_drone]
        found = own or self.general or list(self.of_drone.values())
        more = f"; and {len(found) - 2} more reasons" if len(found) > 2 else ""
        return "; ".join(found[:2]) + more

    def delay_s(self, drones: Sequence[str]) -> float | None:
        """Return the delay that the reason for changing the promise of some drones explains, s; None if the reason is no delay."""
        own = [one for one in drones if one in self.of_drone]
        if own:
            return max((self.delays_s[one] for one in own if one in self.delays_s), default=None)
        return 0.0 if self.delays_s and not self.general else None
