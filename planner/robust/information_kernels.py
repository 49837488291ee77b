"""The information state in which a flight starts, and what follows from it: how much energy it may take, and which winds are likely.

Each member m of the forecast is weighted by its likeness to the wind measured now, and shifted by its own residual:

    r_m = measured - w_m                                                             (`residuals`)
    p_m ~ share_m exp(-|r_m|^2 / (2 sigma^2))                                        (`chances`)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.flight.kernels import NEVER
from skyway.models.jit.compiled import compiled, compiled_lean

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.flight.rules import SegmentWind

MIN_CHANCE = 1e-9
"""Likeness below which a member does not count."""


class Known(NamedTuple):
    """Information of a drone at a decision, and its risk parameters."""

    air: SegmentWind
    """Segments and the members of the forecast."""
    share: NDArray[np.float64]
    """Shape (rows, members). Probability of each member; a row for each truth, so that a truth can be left out of its
    own forecast."""
    measured: bool
    """The wind of the hour is measured at the sites; else the members stay as they are."""
    sigma_mps: float
    tau_s: float
    """Standard deviation and correlation time of a member's residual."""
    smoothing: float
    """The wind after the hour of the take-off is less sure than the few members say: each stands for a normal
    distribution about it, of this share of the standard deviation that a residual has gained by then."""
    gust_sd: float
    gust_time_s: float
    """Of gusts, see `planner.schedule.gust_kernels.Disturbance`."""
    energy_mean: float
    energy_between: float
    energy_within: float
    """What is believed of the ratio of measured to modelled energy before the first leg: mean, and variances of the
    part that persists and of that which is fresh on each leg (`models.drones.energy_belief`)."""
    epsilon: float
    """Share of flights that may need more than is charged for."""
    margin: float
    """Calibrated: multiplies the energy that a flight needs beyond that."""
    full: bool
    """Every charge is to 100 %, whatever is needed."""
    worst_members: int
    steady_sigmas: float
    """See `planner.parameters.robust.RobustParameters`."""


@compiled_lean
def energy_belief_after(known: Known, seen: float, legs: int) -> tuple[float, float]:
    """Ratio of energy to the model's to expect of the next leg, after `legs` legs with the mean ratio `seen`.

    Returns the mean, and the standard deviation as a share of the mean before the first leg. With that mean m and the variances
    v (persists) and w (fresh), K = v / (v + w / legs), 0 before the first leg:

        m + K (seen - m),     sqrt((1 - K) v + w) / m

    Takes any finite ratio, and no legs or more.
    """
    gain = 0.0
    if legs > 0 and known.energy_between > 0.0:
        gain = known.energy_between / (known.energy_between + known.energy_within / legs)
    unsure = (1.0 - gain) * known.energy_between + known.energy_within
    return known.energy_mean + gain * (seen - known.energy_mean), math.sqrt(unsure) / known.energy_mean


@compiled
def residuals(
    known: Known, first: int, wind_north: NDArray[np.float64], wind_east: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Wind measured in slot `first` minus that of each member, shape (members, sites).

    r_m, towards north and east, m/s; 0 where nobody measures. The measured wind has shape (sites,).
    """
    air = known.air
    members, _, sites = air.north.shape
    north, east = np.zeros((members, sites)), np.zeros((members, sites))
    if known.measured:
        for m in range(members):
            for site in range(sites):
                north[m, site] = wind_north[site] - air.north[m, first, site]
                east[m, site] = wind_east[site] - air.east[m, first, site]
    return north, east


@compiled
def chances(known: Known, row: int, north: NDArray[np.float64], east: NDArray[np.float64]) -> NDArray[np.float64]:
    """Probability of each member, but for a factor, given its residuals; shape (members,).

    p_m = share_m exp(-|r_m|^2 / (2 sigma^2)), |r_m|^2 the mean square of a component over the sites; the factor makes
    the likeliest member keep its share, so that nothing underflows.
    """
    members, sites = north.shape
    miss, out = np.zeros(members), np.zeros(members)
    least = NEVER
    for m in range(members):
        for site in range(sites):
            # |r_m|^2, and the least of those that count.
            miss[m] += (north[m, site] * north[m, site] + east[m, site] * east[m, site]) / (2.0 * sites)
        if known.share[row, m] > 0.0:
            least = min(least, miss[m])
    for m in range(members):
        out[m] = known.share[row, m] * math.exp(-0.5 * (miss[m] - least) / (known.sigma_mps * known.sigma_mps))
    return out
