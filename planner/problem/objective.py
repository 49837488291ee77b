"""Objectives: time, energy, cost, a weighted sum of them, or several in order.

The words of an objective, as typed::

    objective = single | sum | single [within], then objective | sum [within], then objective
    single    = mean | p95 | on-time DEADLINE | energy | cost
    sum       = term + term …        term = cost | NUMBER/h*time | NUMBER/kWh*energy
    within    = within NUMBER%

A sum is in the scenario's currency. In an order the next objective decides among the plans that are within some percent
(1 % by default) of the best by the one before; of ``on-time`` these are points of the probability.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.units import J_PER_WH, S_PER_H, parse_instant

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

    from skyway.planner.schedule.outcome import Outcome

Kind = Literal["mean", "p95", "on-time", "energy", "cost", "sum", "order"]
EXAMPLE = "mean, p95, energy, cost, 'cost + 12/h*time', 'cost, then mean', or 'on-time 2013-07-10T16:00-04:00'"
KINDS: tuple[Kind, ...] = ("mean", "p95", "on-time", "energy", "cost", "sum", "order")
_WORDS: tuple[Kind, ...] = ("mean", "p95", "energy", "cost")
USUAL_WITHIN = 0.01
"""Of an order: plans within so much of the best count as equally good."""
MAX_WEIGHT = 1e6
J_PER_KWH = 1000.0 * J_PER_WH
_TERM = re.compile(r"(?:(cost)|(\d+(?:\.\d+)?)\s*/\s*(h)\s*\*\s*time|(\d+(?:\.\d+)?)\s*/\s*(kWh)\s*\*\s*energy)")
_WITHIN = re.compile(r"(.*\S)\s+within\s+(\d+(?:\.\d+)?)\s*%")
_THEN = re.compile(r"\s*,\s*then\s+")


@dataclass(frozen=True, slots=True)
class Weights:
    """Weights of a sum, in the scenario's currency.

    Attributes
    ----------
    cost : float
        Multiple of the cost.
    per_h, per_kwh : float
        Price of an hour of delivery time, and of a kWh that is flown.
    """

    cost: float = 0.0
    per_h: float = 0.0
    per_kwh: float = 0.0


@dataclass(frozen=True, slots=True)
class Objective:
    """An objective.

    Attributes
    ----------
    kind : str
        One of `KINDS`: least mean arrival, least 95th percentile, the greatest probability to arrive by the deadline,
        least mean energy, least mean cost, least sum of `weights`, or several objectives in order.
    deadline : datetime or None
        Aware; of ``on-time``, and of an order that begins with it.
    weights : Weights or None
        Of ``sum``.
    steps : tuple of (Objective, float)
        Of ``order``: each with how much worse than the best counts as equally good, as a share of it.

    Raises
    ------
    InputError
        ``on-time`` without a deadline, or a deadline without it; weights or steps that do not fit.
    """

    kind: Kind = "mean"
    deadline: datetime | None = None
    weights: Weights | None = None
    steps: tuple[tuple[Objective, float], ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(Fault("no such objective", field="objective", value=self.kind, remedy=", ".join(KINDS)))
        if self.kind == "order" and self.steps:
            object.__setattr__(self, "deadline", self.steps[0][0].deadline)
        elif (self.kind == "on-time") != (self.deadline is not None):
            remedy = "on-time needs one, the others have none"
            raise InputError(Fault("the deadline does not fit", field="objective", value=self.kind, remedy=remedy))
        if (self.kind == "sum") != (self.weights is not None) or (self.kind == "order") != bool(self.steps):
            remedy = "a sum needs weights, an order needs steps, the others have none"
            raise InputError(Fault("is not complete", field="objective", value=self.kind, remedy=remedy))

    @classmethod
    def parse(cls, text: str) -> Objective:
        """Read an objective, see the module.

        An `InputError` refuses another word, a number out of range, and a deadline without an offset from UTC.
        """
        parts = _THEN.split(text.strip())
        if len(parts) == 1:
            return cls._parse_one(parts[0], text)
        steps: list[tuple[Objective, float]] = []
        for number, part in enumerate(parts):
            found = _WITHIN.fullmatch(part)
            within = USUAL_WITHIN if found is None else float(found[2]) / 100.0
            one = cls._parse_one(part if found is None else found[1], text)
            if found is not None and number == len(parts) - 1:
                raise InputError(
                    Fault("has nothing after the last within", field="objective", value=text, remedy=EXAMPLE)
                )
            if within > 1.0:
                raise InputError(Fault("within 0 to 100 %", field="objective", value=text, remedy="such as within 5%"))
            if one.kind == "on-time" and number:
                remedy = "begin with it: 'on-time 2013-07-10T16:00-04:00 within 1%, then cost'"
                raise InputError(Fault("a deadline comes first", field="objective", value=text, remedy=remedy))
            steps.append((one, within))
        return cls("order", steps=tuple(steps))

    @classmethod
    def _parse_one(cls, text: str, whole: str) -> Objective:
        kind, _, deadline = text.partition(" ")
        if kind == "on-time" and deadline:
            return cls("on-time", parse_instant(deadline.strip(), field="objective"))
        for known in _WORDS:
            if text == known:
                return cls(known)
        terms = [_TERM.fullmatch(term.strip()) for term in text.split("+")]
        found = [term for term in terms if term is not None]
        if len(found) < len(terms):
            lower = text.lower()
            remedy = f"did you mean {lower}?" if lower in _WORDS else EXAMPLE
            raise InputError(Fault("is not an objective", field="objective", value=whole, remedy=remedy))
        counted = [term[1] or term[3] or term[5] for term in found]
        if len(set(counted)) < len(counted):
            raise InputError(Fault("counts something twice", field="objective", value=whole, remedy=EXAMPLE))
        values = {name: float(term[2] or term[4] or 1.0) for name, term in zip(counted, found, strict=True)}
        if not all(0.0 < value <= MAX_WEIGHT for value in values.values()):
            remedy = f"a price above 0 and up to {MAX_WEIGHT:g}"
            raise InputError(Fault("has a weight out of range", field="objective", value=whole, remedy=remedy))
        return cls("sum", weights=Weights(values.get("cost", 0.0), values.get("h", 0.0), values.get("kWh", 0.0)))

    @property
    def singles(self) -> tuple[Objective, ...]:
        """The objectives that an order is made of; else this one."""
        return tuple(one for one, _ in self.steps) if self.steps else (self,)

    @property
    def searched(self) -> tuple[Weights, ...]:
        """Additional criteria of the route search beside early arrival."""
        of_kind = {"energy": Weights(per_kwh=1.0), "cost": Weights(cost=1.0)}
        found = (one.weights or of_kind.get(one.kind) for one in self.singles)
        return tuple(dict.fromkeys(one for one in found if one is not None))

    @property
    def counts_cost(self) -> bool:
        """Whether the cost matters to it."""
        return any(one.cost > 0.0 for one in self.searched)

    @property
    def beside_time(self) -> bool:
        """Whether anything but the time matters to it."""
        return bool(self.searched)

    def loss(self, outcome: Outcome, since_s: float = 0.0) -> tuple[float, ...]:
        """Quantity to minimise, lexicographically: seconds since a time, the probability of being late, kWh, or money."""
        mean, late = outcome.mean_s - since_s, outcome.quantile_s(0.95) - since_s
        if self.kind in ("mean", "p95", "on-time"):
            return {"mean": (mean, late), "p95": (late, mean), "on-time": (1.0 - self.on_time(outcome), mean)}[
                self.kind
            ]
        if self.kind == "order":
            return (*(one.loss(outcome, outcome.start_s)[0] for one in self.singles), mean)
        weights = self.searched[0]
        spent = outcome.spending
        if spent is None or not len(outcome.weight):
            return math.inf, mean
        total = weights.per_h * (outcome.mean_s - outcome.start_s) / S_PER_H
        total += weights.per_kwh * outcome.average(spent.energy_j) / J_PER_KWH
        if weights.cost:
            total += weights.cost * outcome.average(spent.cost)
        return total, mean

    def ranked(self, orders: Sequence[tuple[float, ...]]) -> list[int]:
        """Order plans, best first, by what is more important than the loss, and then the loss: numbers of `orders`.

        Each of `orders` ends with a `loss`. In an order of objectives, those within the tolerance of the best by one of them
        are compared by the next.
        """
        numbers = sorted(range(len(orders)), key=lambda number: orders[number])
        if not self.steps or not numbers:
            return numbers
        before = len(orders[numbers[0]]) - len(self.steps) - 1
        kept = [number for number in numbers if orders[number][:before] == orders[numbers[0]][:before]]
        for place, (one, within) in enumerate(self.steps[:-1], before):
            least = min(orders[number][place] for number in kept)
            most = least + within * (1.0 if one.kind == "on-time" else abs(least))
            kept = [number for number in kept if orders[number][place] <= most]
        kept.sort(key=lambda number: orders[number][before + len(self.steps) - 1 :])
        return kept + [number for number in numbers if number not in set(kept)]

    def on_time(self, outcome: Outcome) -> float:
        """Probability to arrive by the deadline."""
        if self.deadline is None:
            return outcome.p_arrive
        return outcome.p_by(self.deadline.timestamp())
