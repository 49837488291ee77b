"""Validation of kernel inputs, since kernels index arrays without checks.

Networks, forecasts, requests and loads are checked when they are made. What is left is what a caller puts together himself: which member
and which set of queues each run meets, the flights of an itinerary, a table of speeds.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.network.network import Network
    from skyway.models.queues.paths import PackedPaths
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.gust_kernels import Disturbance
    from skyway.planner.schedule.itinerary import Itinerary


def check_itinerary(network: Network, itinerary: Itinerary) -> None:
    """Refuse flights that do not follow each other over segments of a network.

    An `InputError` names no flight, a flight without segments, a segment that is none, one that does not begin where
    the one before ends, or a charge that is not a fraction.
    """
    if not itinerary:
        raise InputError(Fault("has no flight", field="itinerary", remedy="at least one"))
    lengths = [len(leg.segments) for leg in itinerary]
    if 0 in lengths:
        raise InputError(Fault("has no segments", field=f"itinerary[{lengths.index(0)}]"))
    segments = np.array([segment for leg in itinerary for segment in leg.segments])
    count = len(network.head)
    if segments.dtype.kind not in "iu" or segments.min() < 0 or segments.max() >= count:
        raise InputError(Fault("is not a segment", field="itinerary", value=segments, remedy=f"0 to {count - 1}"))
    if (network.head[segments[:-1]] != network.tail[segments[1:]]).any():
        raise InputError(Fault("begins where the segment before does not end", field="itinerary", value=segments))
    for number, leg in enumerate(itinerary):
        if leg.charge_to is not None and not 0.0 <= leg.charge_to <= 1.0 + 1e-9:
            remedy = "a fraction from 0 to 1, or None"
            raise InputError(
                Fault(
                    "is not a state of charge",
                    field=f"itinerary[{number}].charge_to",
                    value=leg.charge_to,
                    remedy=remedy,
                )
            )
        if not leg.not_before_s < math.inf:
            raise InputError(Fault("is not a time", field=f"itinerary[{number}].not_before_s", value=leg.not_before_s))


def check_whole(problem: Problem, itinerary: Itinerary) -> None:
    """Refuse an itinerary that `check_itinerary` refuses, or that does not lead from the origin to the destination of a request."""
    network = problem.network
    check_itinerary(network, itinerary)
    begin, end = int(network.tail[itinerary[0].segments[0]]), int(network.head[itinerary[-1].segments[-1]])
    for verb, node, wanted in (("begins", begin, problem.origin), ("ends", end, problem.destination)):
        if node != wanted:
            raise InputError(
                Fault(
                    f"{verb} at another station than the request",
                    field="itinerary",
                    value=network.stations[node].id,
                    remedy=network.stations[wanted].id,
                )
            )


def check_runs(
    members: NDArray[np.int64], count: int, disturbance: Disturbance, paths: PackedPaths | None, places: int
) -> None:
    """Refuse runs of a member or a set of queues that is not there, and disturbances of other runs or not finite.

    `members` holds one of the `count` members for each run. Paths are in order (place, set), None where expected waits
    are used; places are the stops before each flight, and the end.
    """
    runs = len(members)
    _check_index("member", members, count, "members")
    for name in ("queue", "energy", "gust_key"):
        values = getattr(disturbance, name)
        if (
            np.shape(values)[:1] != (runs,)
            or np.ndim(values) != (2 if name == "energy" else 1)
            or not np.size(values) >= runs
        ):
            raise InputError(
                Fault(f"must have one value for each of {runs} runs", field=f"sky.{name}", value=np.shape(values))
            )
    if not (np.isfinite(disturbance.energy).all() and (disturbance.energy >= 0.0).all()):
        raise InputError(Fault("must be finite and 0 or more", field="sky.energy"))
    if not (0.0 <= disturbance.gust_sd < math.inf and 0.0 < disturbance.gust_time_s < math.inf):
        raise InputError(
            Fault(
                "are not gusts",
                field="sky.gust_sd, sky.gust_time_s",
                value=(disturbance.gust_sd, disturbance.gust_time_s),
            )
        )
    if paths is not None:
        if len(paths) % places:
            remedy = f"one for each of {places} places in every set, in order (place, set)"
            raise InputError(Fault("does not fit the itinerary", field="paths", value=len(paths), remedy=remedy))
        _check_index("sky.queue", disturbance.queue, len(paths) // places, "sets of queues")


def check_speeds(speeds: NDArray[np.float64], segments: int) -> None:
    """Refuse a table of ground speeds that is not one row a slot and one column a segment, finite and 0 or more."""
    if speeds.ndim != 2 or speeds.shape[1] != segments or not len(speeds):
        remedy = f"shape (slots, {segments})"
        raise InputError(Fault("has the wrong shape", field="speeds", value=speeds.shape, remedy=remedy))
    if not (np.isfinite(speeds).all() and (speeds >= 0.0).all()):
        raise InputError(Fault("must be finite and 0 or more, m/s", field="speeds"))


def check_shape(field: str, values: NDArray[Any], shape: tuple[int, ...]) -> None:
    """Refuse an array of another shape."""
    if np.shape(values) != shape:
        raise InputError(Fault("has the wrong shape", field=field, value=np.shape(values), remedy=f"{shape}"))


def _check_index(field: str, values: NDArray[np.int64], count: int, what: str) -> None:
    whole = np.asarray(values)
    if whole.ndim != 1 or (len(whole) and (whole.dtype.kind not in "iu" or whole.min() < 0 or whole.max() >= count)):
        raise InputError(Fault(f"is not one of {count} {what}", field=field, value=whole, remedy=f"0 to {count - 1}"))
