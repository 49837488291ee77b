"""Objectives: mean delivery time, its 95th percentile, or arrival by a deadline."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.units import parse_instant

if TYPE_CHECKING:
    from datetime import datetime

    from skyway.planner.schedule.outcome import Outcome

Kind = Literal["mean", "p95", "on-time"]
EXAMPLE = "mean, p95, or 'on-time 2013-07-10T16:00-04:00'"
KINDS: tuple[Kind, ...] = ("mean", "p95", "on-time")


@dataclass(frozen=True, slots=True)
class Objective:
    """An objective.

    Attributes
    ----------
    kind : ``mean``, ``p95`` or ``on-time``
        Least mean arrival, least 95th percentile, or the greatest probability to arrive by the deadline.
    deadline : datetime or None
        Aware; of ``on-time`` only.

    Raises
    ------
    InputError
        ``on-time`` without a deadline, or a deadline without it.
    """

    kind: Kind = "mean"
    deadline: datetime | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(Fault("no such objective", field="objective", value=self.kind, remedy=", ".join(KINDS)))
        if (self.kind == "on-time") != (self.deadline is not None):
            remedy = "on-time needs one, mean and p95 have none"
            raise InputError(Fault("the deadline does not fit", field="objective", value=self.kind, remedy=remedy))

    @classmethod
    def parse(cls, text: str) -> Objective:
        """Read an objective: ``mean``, ``p95``, ``on-time 2013-07-10T16:00-04:00``.

        An `InputError` refuses another word, and a deadline without an offset from UTC.
        """
        kind, _, deadline = text.strip().partition(" ")
        if kind == "on-time" and deadline:
            return cls("on-time", parse_instant(deadline.strip(), field="objective"))
        if kind in ("mean", "p95") and not deadline:
            return cls("p95" if kind == "p95" else "mean")
        raise InputError(Fault("is not an objective", field="objective", value=text, remedy=EXAMPLE))

    def loss(self, outcome: Outcome, since_s: float = 0.0) -> tuple[float, float]:
        """What to make small, first by the first number: seconds since a time, or the probability to be late and then seconds."""
        mean, late = outcome.mean_s - since_s, outcome.quantile_s(0.95) - since_s
        return {"mean": (mean, late), "p95": (late, mean), "on-time": (1.0 - self.on_time(outcome), mean)}[self.kind]

    def on_time(self, outcome: Outcome) -> float:
        """Probability to arrive by the deadline."""
        if self.deadline is None:
            return outcome.p_arrive
        return outcome.p_by(self.deadline.timestamp())
