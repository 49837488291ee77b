"""Parameters of the exact planner."""

from __future__ import annotations

import math
from dataclasses import dataclass

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.parameters import Parameters, parameter

_SPEED = "chosen for speed (commit 100d26f, whose figures were not kept); the answer does not depend on it"


@dataclass(frozen=True)
class ExactParameters(Parameters):
    """Deadlines and cells of `planner.exact`: they affect its speed, never its result."""

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
    near_stations: int = parameter(
        120,
        "stations nearest to the straight way, by flight and charging, among which a first answer is looked for in dense networks",
        2,
        10**6,
        measured="benchmarks.planners.bench_dense (decision 84)",
    )
    near_tries: int = parameter(
        2, "searches among these without an answer, each for a later arrival, after which a search with a time limit doubles their number each time", 1, 100,
        measured="1,000 stations on 60 km: of 400 routes of `robust` two do not lead over 120 stations; 0.2 s less; searches for the best take twice as long at worst (decision 139)",
    )  # fmt: skip
    dense_segments: int = parameter(
        20_000,
        "a network is dense where more segments leave the stations that a delivery may use",
        1,
        10**9,
        measured=_SPEED,
    )
    near_deadlines: tuple[float, ...] = parameter(
        (0.25, 0.7, math.inf), "deadlines among these stations, likewise", 0,
        measured="1,000 stations on 60 km: with 0.08 before, a fifth slower, the same deliveries (decision 84)",
    )  # fmt: skip
    near_states: int = parameter(
        1_500_000,
        "greatest number of finer cells over all nodes of a dense network",
        1000,
        10**9,
        measured="memory: 150 MB",
    )
    hurry_s: float = parameter(
        5.0, "time limit below which any answer is looked for first, and the best after that", 0, 3600, unit="s"
    )
    near_labels: int = parameter(
        60,
        "labels in which an answer among these stations is looked for once there is one: it need not be the best",
        1,
        10**9,
        measured=_SPEED,
    )
    near_cells: tuple[float, ...] = parameter(
        (3.0, 9.0, 27.0, 81.0, math.inf), "the same in dense networks, in finer cells beyond the lower bound; the last one must be inf", 0,
        measured="1,000 stations on 60 km: the best is mostly within ten cells of the bound (decision 131)",
    )  # fmt: skip
    proof_cells: tuple[float, ...] = parameter(
        (4.0, 16.0, 64.0, math.inf), "deadlines of the proof in dense networks, in cells beyond the lower bound; the last one must be inf", 0,
        measured="1,000 stations on 60 km: where the answer near the straight way is an hour late, half the time (decision 131)",
    )  # fmt: skip
    gate_labels: int = parameter(
        400,
        "labels in which the best delivery after a time when stations open is looked for, and a way to it",
        1,
        10**9,
        measured=_SPEED,
    )
    many_labels: int = parameter(
        3000, "labels made in a dense network, after which a search is done again with finer cells", 1, 10**9,
    )  # fmt: skip
    finer: int = parameter(4, "that many for each cell then, at most", 2, 100)
    gate_late_s: float = parameter(
        1.0, "how much later than the best delivery after such a time that way may arrive", 1e-5, 3600, unit="s",
        measured="a delivery of 22 hours at 1,000 stations: found in 6 labels; with the deadline of the search, not in 400 (decision 131)",
    )  # fmt: skip
    first_labels: int = parameter(
        30, "labels in which a first answer is looked for there up to one deadline, before the next one's turn", 1, 10**9,
        measured="1,000 stations on 60 km: where 60 labels found nothing, 800 did not either (decision 84)",
    )  # fmt: skip
    nearness: float = parameter(
        3.0, "seconds of charging to spare that a second less of flight to the destination is worth while a first answer is looked for", 0, 1000,
        measured="1,000 stations on 60 km: a delivery of 31 hours in 117 labels, without it in 780 (decision 131)",
    )  # fmt: skip
    nearness_labels: int = parameter(
        100, "labels in which it is; after that, what has the most to spare comes first", 0, 10**9,
        measured="1,000 stations on 60 km: with 30 a delivery of 31 hours takes three times as long (decision 131)",
    )  # fmt: skip
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
        """Refuse values that are out of range, and deadlines that end before the last arrival."""
        super().__post_init__()
        for name in ("deadlines", "near_cells", "near_deadlines", "proof_cells", "refinements"):
            shares = getattr(self, name)
            if not math.isinf(shares[-1]):
                raise InputError(Fault("must end with inf", field=name, value=shares, remedy="0.08,0.25,0.7,inf"))
