"""Update of a wind forecast with measured winds, counting each only once.

Each member of the ensemble is taken to be the truth but for a residual of known size, correlation time and length
(`models.wind.estimation.field.ResidualModel`). The likelihood of all observations under that weights the member; the residual that
is then expected at a horizon h, which falls as ``exp(-h / tau)``, shifts it. The wind between the sites of a forecast is what is
interpolated from them, so an observation there tells of the residuals of the sites through the weights of the interpolation: the
updated forecast says at its place what was measured, however far the sites are. Observations are averages over slots: at
10 Hz neighbouring samples say the same, and counting them all would leave one member with all the weight.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.wind.estimation.field import ResidualModel, WindObservation, check_observations, places

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.models.wind.estimation.filter import WindEstimate

SLOT_S = 600.0
"""Observations are averaged over so long."""
REPRESENTATION_MPS = 0.7
"""How far the mean of a slot along a track is from the wind that the forecast means. It is added to the filter's own
uncertainty, which an average over correlated estimates does not reduce."""
HALVINGS = 20
MAX_SLOTS = 20_000


class SlotAverages:
    """Averages a filter's course over slots as it goes, so that no correlated estimate counts as a new observation.

    Slots begin at whole multiples of `SLOT_S`.
    """

    def __init__(self) -> None:
        self._sums: dict[int, list[float]] = {}

    def add(self, now: WindEstimate, lat_deg: float, lon_deg: float, height_m: float = math.nan) -> None:
        """Take an estimate that something was measured for; without a place it is left out."""
        if not (math.isfinite(lat_deg) and math.isfinite(lon_deg)):
            return
        sums = self._sums.setdefault(math.floor(now.time_s / SLOT_S), [0.0] * 8)
        variance = 0.5 * (now.var_north + now.var_east)
        values = (1.0, now.time_s, lat_deg, lon_deg, now.north_mps, now.east_mps, variance, height_m)
        for place, value in enumerate(values):
            sums[place] += value

    def observations(self) -> tuple[WindObservation, ...]:
        """One observation for each slot in which something was measured, the one under way included."""
        found = []
        for count, *totals in (self._sums[slot] for slot in sorted(self._sums)):
            time_s, lat, lon, north, east, variance, height_m = (total / count for total in totals)
            found.append(WindObservation(time_s, lat, lon, north, east, variance + REPRESENTATION_MPS**2, height_m))
        return tuple(found)


def refined(ensemble: WindEnsemble, slot_s: float) -> WindEnsemble:
    """Return the same wind in shorter slots, for updates whose effect fades within a slot."""
    parts = max(1, math.ceil(ensemble.slot_s / slot_s - 1e-9))
    if parts * ensemble.slots > MAX_SLOTS:
        raise InputError("too fine", field="slot_s", value=slot_s)
    return replace(
        ensemble,
        slot_s=ensemble.slot_s / parts,
        north=np.repeat(ensemble.north, parts, axis=1),
        east=np.repeat(ensemble.east, parts, axis=1),
    )


def update_forecast(
    ensemble: WindEnsemble,
    observations: Sequence[WindObservation],
    residual: ResidualModel | None = None,
    *,
    slot_s: float = SLOT_S,
    least_members: float = 1.0,
) -> WindEnsemble:
    """Weight and shift the members of a forecast by what was measured.

    The ensemble is at the height of the observations (`WindEnsemble.at_height`), which are averages over slots, of any
    drones. The updated forecast has slots of at most `slot_s`, and the same members and sites; without observations it
    is the same ensemble. The weights are flattened until they are worth `least_members` equal ones: a few members that
    fit what was measured now would else stand for all that may come in the hours after.
    """
    if not observations:
        return ensemble
    check_observations(observations)
    model = residual or ResidualModel()
    where = places(observations)
    seen = ensemble.at_times(where[1], where[2], where[0])
    told = np.array([(one.north_mps, one.east_mps) for one in observations]).T
    misses = np.stack(
        tuple(one - expected for one, expected in zip(told, seen, strict=True)), axis=-1
    )  # (members, observations, 2)
    noise = np.array([one.variance for one in observations])
    sites = np.zeros(len(ensemble.site_lat)), ensemble.site_lat, ensemble.site_lon
    weight = ensemble.weights(where[1], where[2])
    reach = weight @ model.covariance(sites, sites)  # of each observation with each site at the same time, m2/s2
    inverse = np.linalg.inv(reach @ weight.T * model.fade(where[0], where[0]) + np.diag(noise))
    pressed = np.einsum("kl,mlc->mkc", inverse, misses)
    cost = 0.5 * np.einsum("mkc,mkc->m", misses, pressed)
    likelihood = np.exp(cost.min() - cost)
    fine = refined(ensemble, slot_s)
    begin, latest = fine.start_s + np.arange(fine.slots) * fine.slot_s, float(where[0].max())
    middle = np.where(begin <= latest, np.minimum(begin + fine.slot_s / 2.0, latest), begin + fine.slot_s / 2.0)
    # sum over observations k of fade[t, k] reach[k, s] pressed[m, k, c], as one product of matrices
    felt = (model.fade(middle, where[0])[:, None, :] * reach.T).reshape(-1, len(observations))
    shift = (felt @ pressed.transpose(1, 2, 0).reshape(len(observations), -1)).reshape(fine.slots, -1, 2, len(fine))
    north, east = shift.transpose(2, 3, 0, 1)
    moved = replace(fine, north=fine.north + north, east=fine.east + east)
    if not float((moved.probability * likelihood).sum()) > 0.0:
        return moved
    return moved.weighted(_flattened(moved.probability, likelihood, least_members))


def worth(weights: NDArray[np.float64]) -> float:
    """Return how many equal weights some weights are worth: (sum w)^2 / sum w^2 (L. Kish, "Survey Sampling", 1965)."""
    return float(weights.sum() ** 2 / (weights**2).sum())


def _flattened(probability: NDArray[np.float64], likelihood: NDArray[np.float64], least: float) -> NDArray[np.float64]:
    """Return the greatest power of likelihoods, at most 1, with which the members are worth at least so many."""
    if worth(probability * likelihood) >= min(least, worth(probability)):
        return likelihood
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        power = 0.5 * (low + high)
        low, high = (power, high) if worth(probability * likelihood**power) >= least else (low, power)
    return likelihood**low
