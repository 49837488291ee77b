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

    def __bool__(self) -> bool:
        return bool(self.general or self.of_drone)

    def why(self, drones: Sequence[str]) -> str:
        """Return the reason for changing the promise of some drones."""
        own = [self.of_drone[one] for one in dict.fromkeys(drones) if one in self.of_drone]
        found = own or self.general or list(self.of_drone.values())
        more = f"; and {len(found) - 2} more reasons" if len(found) > 2 else ""
        return "; ".join(found[:2]) + more
