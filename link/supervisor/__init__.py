"""Supervision of a delivery: leg by leg, learning and replanning, journaled; no other part of `link` plans.

`Supervisor` takes a `DeliveryJob` to its end over any `link.vehicle.vehicle.Vehicle`; `states` is its table of states.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.models.base.lazy import exports

if TYPE_CHECKING:
    from skyway.link.supervisor.job import DeliveryJob as DeliveryJob
    from skyway.link.supervisor.job import Outcome as Outcome
    from skyway.link.supervisor.journal.file import Journal as Journal
    from skyway.link.supervisor.journal.file import Record as Record
    from skyway.link.supervisor.journal.file import read_journal as read_journal
    from skyway.link.supervisor.machine import Supervisor as Supervisor
    from skyway.link.supervisor.operators import NobodyThere as NobodyThere
    from skyway.link.supervisor.operators import Operator as Operator
    from skyway.link.supervisor.states import State as State

__all__, __getattr__ = exports(__name__)
