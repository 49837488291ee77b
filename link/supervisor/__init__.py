"""Supervision of a delivery: leg by leg, learning and replanning, journaled; the only part of `link` that plans.

`Supervisor` takes a `DeliveryJob` to its end over any `link.vehicle.vehicle.Vehicle`; `states` is the table it goes by.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skyway.link.supervisor.job import DeliveryJob, Outcome
    from skyway.link.supervisor.journal.file import Journal, Record, read_journal
    from skyway.link.supervisor.machine import Supervisor
    from skyway.link.supervisor.operators import NobodyThere, Operator
    from skyway.link.supervisor.states import State

_HOMES = {
    "Journal": "journal.file",
    "DeliveryJob": "job",
    "NobodyThere": "operators",
    "Operator": "operators",
    "Outcome": "job",
    "Record": "journal.file",
    "State": "states",
    "Supervisor": "machine",
    "read_journal": "journal.file",
}

__all__ = [
    "DeliveryJob",
    "Journal",
    "NobodyThere",
    "Operator",
    "Outcome",
    "Record",
    "State",
    "Supervisor",
    "read_journal",
]


def __getattr__(name: str) -> object:
    """Import what is asked for, and no sooner."""
    if name not in _HOMES:
        raise AttributeError(f"module 'skyway.link.supervisor' has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
