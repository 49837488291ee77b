"""The best selection of routes that serve every customer once: a set partitioning problem, solved by HiGHS."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from scipy.sparse import csr_array

EDGE = 1e-6
"""A selection is better if it costs less by this."""


class Jobs(NamedTuple):
    """Demand of routes for the chargers at the depot, shape (routes,) each."""

    periods: NDArray[np.int64]
    by: NDArray[np.int64]
    """Period by which it must be charged."""
    chargers: int


def partition(
    served: csr_array,
    cost: NDArray[np.float64],
    *,
    most_cost: float,
    most_routes: int | None = None,
    jobs: Jobs | None = None,
    apart: Sequence[Sequence[int]] = (),
    time_limit_s: float = 10.0,
) -> NDArray[np.int64] | None:
    """Return the numbers of the routes that serve every customer once at least total cost; None if none below a cost was found in time.

    Minimize sum c_r x_r with sum_r a_ir x_r = 1 for each customer i, x binary; at most `most_routes`. For each period t the routes that must be
    charged by then need at most the capacity of all chargers: sum of p_r x_r <= chargers t; for one charger that is exact. Columns whose reduced cost
    in the linear relaxation is above the gap to `most_cost` are in no better selection, and omitted.

    Parameters
    ----------
    served : csr_array, shape (customers, routes)
        1 where a route serves a customer.
    cost : array, shape (routes,)
        Cost of each route.
    most_cost : float
        Upper bound of the cost.
    most_routes : int, optional
        Maximum number of routes.
    jobs : Jobs, optional
        Demand of the routes for the chargers at the depot.
    apart : sequence of sequence of int
        Routes that cannot all be chosen together.
    time_limit_s : float
        Time limit of the integer program.
    """
    from scipy.optimize import Bounds, LinearConstraint, linprog, milp
    from scipy.sparse import csr_array, vstack

    above = [np.ones((1, len(cost)))] if most_routes is not None else []
    limits = [float(most_routes)] if most_routes is not None else []
    if jobs is not None:
        for by in np.unique(jobs.by):
            above.append(np.where(jobs.by <= by, jobs.periods, 0)[None].astype(float))
            limits.append(float(jobs.chargers * by))
    for chosen in apart:
        row = np.zeros((1, len(cost)))
        row[0, list(chosen)] = 1.0
        above.append(row)
        limits.append(len(chosen) - 1.0)
    rows = csr_array(np.concatenate(above)) if above else None
    relaxed = linprog(  # type: ignore[call-overload]
        cost,
        A_ub=rows,
        b_ub=limits or None,
        A_eq=served,
        b_eq=np.ones(served.shape[0]),
        bounds=(0, None),
        method="highs",
    )
    if relaxed.status != 0 or relaxed.fun >= most_cost - EDGE:
        return None
    kept = np.flatnonzero(relaxed.lower.marginals <= most_cost - relaxed.fun + EDGE)
    matrix, low, high = served[:, kept], np.ones(served.shape[0]), np.ones(served.shape[0])
    if rows is not None:
        matrix = vstack((matrix, rows[:, kept])).tocsr()
        low, high = np.concatenate((low, np.full(len(limits), -np.inf))), np.concatenate((high, limits))
    found = milp(
        cost[kept], constraints=LinearConstraint(matrix, low, high), integrality=np.ones(len(kept), dtype=np.int64), bounds=Bounds(0, 1),
        options={"time_limit": time_limit_s, "mip_rel_gap": 0.0},
    )  # fmt: skip
    if found.x is None or found.fun >= most_cost - EDGE:
        return None
    picked: NDArray[np.int64] = kept[found.x > 0.5]
    return picked
