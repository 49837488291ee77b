"""Flight modes of an autopilot family: numbers and names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


@dataclass(frozen=True, slots=True)
class Modes:
    """The flight modes of one family."""

    numbers: Mapping[str, int]
    """``custom_mode`` by the names that the families share: ``hold``, ``mission``, ``return``, ``land``, ``position``,
    and ``guided``, in which it flies to a place that a command names."""
    names: Mapping[int, str]
    """Name for a person by ``custom_mode``."""
    command: Callable[[int], tuple[float, ...]]
    """Parameters of DO_SET_MODE after the first, of a ``custom_mode``."""
    log_names: Callable[[str, int], str | None]
    """Name in logs of the family's own ground station, by kind of vehicle (`link.logs.common.vehicle_kind`)
    and ``custom_mode``; None for an unknown one."""
    on_rotors: tuple[int, ...] = ()
    """Modes in which a plane flies on its rotors."""

    def name(self, custom_mode: int) -> str:
        """Name of a mode, for a person."""
        return self.names.get(custom_mode, f"mode {custom_mode}")

    def log_name(self, kind: str, custom_mode: int) -> str:
        """Name of a mode, for a person who knows the family's own ground station."""
        return self.log_names(kind, custom_mode) or f"number {custom_mode}"
