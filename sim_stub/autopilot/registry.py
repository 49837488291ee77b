"""The registry of the simulated families."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from skyway.sim_stub import autopilot

if TYPE_CHECKING:
    from skyway.sim_stub.autopilot.base import Autopilot

FAMILIES: dict[str, type[Autopilot]] = {
    name: import_module(f"{autopilot.__name__}.{name}").FAMILY for name in autopilot.NAMES
}
"""Every family by name."""
