"""Parameters of the exact planner."""

from __future__ import annotations

import math
from dataclasses import dataclass

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.parameters import Parameters, parameter

_SPEED = "chosen for speed (commit 100d26f, whose figures were not kept); the answer does not depend on it"


@dataclass(frozen=True)
class ExactParameters(Parameters):
    """Deadlines and cells of `planner.exact`: how fast it is, never what it answers."""

    first_deadline: float = parameter(
        2.2, "the first deadline, as a multiple of what the straight way would take", 1, 100, measured=_SPEED
    )
    deadlines: tuple[float, ...] = parameter(
        (0.08, 0.25, 0.7, math.inf), "how far beyond the lower bound deadlines go, as shares of it, before more of the network is "
        "laid out; the last one must be inf", 0, measured=_SPEED,
    )  # fmt: skip
    refinements: tuple[float, ...] = parameter(
        (0.01, 0.03, math.inf), "the same within one part of the network; the last one must be inf", 0, measured=_SPEED
    )
    coarse_cells: int = parameter(
        240,
        "cells that the time up to the first deadline is cut into, about; at least 10 s each",
        10,
        100_000,
        measured=_SPEED,
    )
    fine_s: float = parameter(30.0, "length of finer cells, about", 1, 3600, unit="s", measured=_SPEED)
    min_fine_cells: int = parameter(700, "least number of finer cells up to the deadline", 1, 10**6, measured=_SPEED)
    max_fine_cells: int = parameter(
        4500, "greatest number of finer cells up to the deadline", 1, 10**6, measured=_SPEED
    )
    max_states: int = parameter(
        5_000_000,
        "greatest number of finer cells over all nodes; each takes 40 bytes",
        1000,
        10**9,
        measured="memory: 200 MB",
    )

    def __post_init__(self) -> None:
        """Refuse what is out of range, and deadlines that end before the last arrival."""
        super().__post_init__()
        for name in ("deadlines", "refinements"):
            shares = getattr(self, name)
            if not math.isinf(shares[-1]):
                raise InputError(Fault("must end with inf", field=name, value=shares, remedy="0.08,0.25,0.7,inf"))
