"""Update of a wind forecast with measured winds, counting each only once.

Each member of the ensemble is taken to be the truth except for a residual of known size, correlation time and length
(`models.wind.estimation.field.ResidualModel`). The likelihood of all observations under that weights the member; the expected
residual at a horizon h, which falls as ``exp(-h / tau)``, shifts it. The wind between the sites of a forecast is
interpolated from them, so an observation there updates the residuals of the sites through the weights of the interpolation: the
updated forecast at its place equals the measurement, regardless of the distance of the sites. Observations are averages over slots: at
10 Hz neighbouring samples are redundant, and counting them all would leave one member with all the weight.

Between the sites the wind differs from the interpolation (`models.wind.field_error`). That error is estimated separately from the residuals of the
sites by its covariance, and its expected value at a drone's position can be added as a site of its own.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.errors import InputError
from skyway.models.wind.estimation.field import (
    ResidualModel,
    WindObservation,
    check_observations,
    gust_covariance,
    noise_covariance,
    places,
)
from skyway.models.wind.felt_gust import FeltGust
from skyway.models.wind.field_error import EXACT_FIELD
from skyway.models.wind.gusts import GUST_LENGTH_M, GUST_SD, GUST_TIME_S, gust_mean_variance

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.models.wind.estimation.filter import WindEstimate
    from skyway.models.wind.field_error import FieldError

SLOT_S = 600.0
"""An updated forecast has slots of this length."""
MEASURED_S = 150.0
"""Averaging time of observations: a drone flies two kilometres meanwhile, over which the wind may grow by some metres per second."""
REPRESENTATION_MPS = 0.2
"""Standard deviation of the wind along a track about the forecast, without gusts. It is added to the filter's own
uncertainty, which an average over correlated estimates does not reduce."""
SHORTEST_S = 20.0
"""Shortest averaging time of a wind: the filter has its own memory."""
HALVINGS = 20
MAX_SLOTS = 20_000


class SlotAverages:
    """Averages a filter's estimates over slots, so that correlated estimates do not count as new observations.

    Slots begin at whole multiples of `MEASURED_S`. Gusts that a slot is too short to average out are noise (`models.wind.gusts`).
    """

    def __init__(self) -> None:
        self._sums: dict[int, list[float]] = {}
        self._began_s: dict[int, float] = {}
        self._ended_s: dict[int, float] = {}

    def add(self, now: WindEstimate, lat_deg: float, lon_deg: float, height_m: float = math.nan) -> None:
        """Add an estimate based on a measurement; without a place it is ignored."""
        if not (math.isfinite(lat_deg) and math.isfinite(lon_deg)):
            return
        slot = math.floor(now.time_s / MEASURED_S)
        self._began_s.setdefault(slot, now.time_s)
        self._ended_s[slot] = now.time_s
        sums = self._sums.setdefault(slot, [0.0] * 8)
        variance = 0.5 * (now.var_north + now.var_east)
        values = (1.0, now.time_s, lat_deg, lon_deg, now.north_mps, now.east_mps, variance, height_m)
        for place, value in enumerate(values):
            sums[place] += value

    def observations(self) -> tuple[WindObservation, ...]:
        """One observation for each slot with a measurement, the current one included."""
        found = []
        for slot in sorted(self._sums):
            count, *totals = self._sums[slot]
            time_s, lat, lon, north, east, variance, height_m = (total / count for total in totals)
            variance += slot_variance(math.hypot(north, east), self._ended_s[slot] - self._began_s[slot])
            found.append(WindObservation(time_s, lat, lon, north, east, variance, height_m))
        return tuple(found)


def slot_variance(speed_mps: float, duration_s: float) -> float:
    """Variance of a component of the mean wind of a slot about the forecast, m2/s2, in addition to the filter's uncertainty."""
    gust = (GUST_SD * speed_mps) ** 2 * gust_mean_variance(GUST_TIME_S / max(duration_s, SHORTEST_S))
    return REPRESENTATION_MPS**2 + gust


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
    field: FieldError = EXACT_FIELD,
    here: tuple[float, float] | None = None,
) -> WindEnsemble:
    """Weight and shift the members of a forecast by measurements.

    The ensemble is at the height of the observations (`WindEnsemble.at_height`), which are averages over slots, of any
    drones. The updated forecast has slots of at most `slot_s`, and the same members and sites; without observations it
    is the same ensemble. The weights are flattened until they are worth `least_members` equal ones: otherwise a few members that
    fit the present measurements would represent all possible winds of the hours after.

    `field` is the error of the wind between the sites, at the height of the ensemble; it does not count between the nodes of a lattice. With it
    and a place `here`, degrees, the updated forecast has one more site there. What is measured at `here` besides the wind of the
    hour is told as a gust (`WindEnsemble.gust`).
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
    sites = np.zeros(len(ensemble.site_lat)), ensemble.site_lat, ensemble.site_lon
    weight = ensemble.weights(where[1], where[2])
    reach = weight @ model.covariance(sites, sites)  # of each observation with each site at the same time, m2/s2
    known = reach @ weight.T * model.fade(where[0], where[0]) + noise_covariance(observations)
    local = _Local.of(ensemble, where, weight, here, field, told) if ensemble.lattice is None else None
    inverse = np.linalg.inv(known if local is None else known + local.between)
    pressed = inverse @ misses
    cost = 0.5 * np.einsum("mkc,mkc->m", misses, pressed)
    flat = pressed.transpose(1, 2, 0).reshape(len(observations), -1)
    likelihood = np.exp(cost.min() - cost)
    fine = refined(ensemble, slot_s)
    begin, latest = fine.start_s + np.arange(fine.slots) * fine.slot_s, float(where[0].max())
    middle = np.where(begin <= latest, np.minimum(begin + fine.slot_s / 2.0, latest), begin + fine.slot_s / 2.0)
    north, east = _expected(middle, where[0], model.tau_s, reach.T, flat)
    moved = replace(fine, north=fine.north + north, east=fine.east + east)
    if local is not None and here is not None:
        more = _expected(middle, where[0], field.tau_s, local.here[None], flat)
        moved = _with_site(moved, here, more[..., 0])
    if float((moved.probability * likelihood).sum()) > 0.0:
        moved = moved.weighted(_flattened(moved.probability, likelihood, least_members))
    return moved if here is None else replace(moved, gust=_felt(observations, here, pressed, moved.probability))


def _felt(
    observations: Sequence[WindObservation],
    here: tuple[float, float],
    pressed: NDArray[np.float64],
    probability: NDArray[np.float64],
) -> FeltGust:
    """Return the expected gust in the observation whose gust is most like that at a place after the last one.

    `pressed`, shape (members, observations, 2), are the misses times the inverse of their covariance.
    """
    time_s, lat, lon = places(observations)
    away_m = geodesy.coarse_distance_m(lat, lon, *here)
    nearest = int(np.argmin((time_s.max() - time_s) / GUST_TIME_S + away_m / GUST_LENGTH_M))
    north, east = np.einsum("m,mkc,k->c", probability, pressed, gust_covariance(observations)[nearest]).tolist()
    one = observations[nearest]
    return FeltGust(one.time_s, one.lat_deg, one.lon_deg, north, east)


def _expected(
    middle_s: NDArray[np.float64],
    seen_s: NDArray[np.float64],
    tau_s: float,
    reach: NDArray[np.float64],
    pressed: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the expected error at some sites in each slot, (north, east), shape (2, members, slots, sites).

    It is sum over observations k of exp(-|t - t(k)| / tau) reach[s, k] pressed[k, c, m]. After the last observation t(n) that is its value then times
    exp(-(t - t(n)) / tau), so that the sum is made for the slots up to it alone.

    Parameters
    ----------
    middle_s : ndarray, shape (slots,)
        In order.
    seen_s : ndarray, shape (observations,)
    reach : ndarray, shape (sites, observations)
    pressed : ndarray, shape (observations, 2 * members)
    """
    latest = float(seen_s.max())
    before = int(np.searchsorted(middle_s, latest, side="left"))
    times = np.append(middle_s[:before], latest)
    fade = np.exp(-np.abs(times[:, None] - seen_s) / tau_s)
    felt = (fade[:, None, :] * reach).reshape(-1, len(seen_s))
    found = (felt @ pressed).reshape(len(times), len(reach), 2, -1).transpose(2, 3, 0, 1)
    after = np.exp((latest - middle_s[before:]) / tau_s)
    later = found[:, :, -1:, :] * after[:, None]
    return np.concatenate((found[:, :, :-1, :], later), axis=2)


class _Local(NamedTuple):
    """Covariances of the errors between the sites, m2/s2."""

    between: NDArray[np.float64]
    """Shape (observations, observations)."""
    here: NDArray[np.float64]
    """Shape (observations,). With that at a place, all at one time."""

    @classmethod
    def of(
        cls,
        ensemble: WindEnsemble,
        where: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
        weight: NDArray[np.float64],
        here: tuple[float, float] | None,
        field: FieldError,
        told: NDArray[np.float64],
    ) -> _Local | None:
        """Return the error of observations in a wind as strong as their average; None without an error."""
        if not field.variance > 0.0:
            return None
        lat, lon = np.append(where[1], here[0] if here else []), np.append(where[2], here[1] if here else [])
        weights = weight if here is None else np.concatenate((weight, ensemble.weights(*here)))
        found = field.covariance(lat, lon, weights, ensemble.site_lat, ensemble.site_lon)
        found *= field.in_wind(np.hypot(*told).mean())
        count = len(where[0])
        fade = np.exp(-np.abs(where[0][:, None] - where[0]) / field.tau_s)
        return cls(found[:count, :count] * fade, found[-1, :count])


def _with_site(ensemble: WindEnsemble, here: tuple[float, float], more: NDArray[np.float64]) -> WindEnsemble:
    """Return the same with one more site, where the wind exceeds the interpolation by the given amount; (north, east), shape (2, members, slots)."""
    weight = ensemble.weights(*here)[0]
    north, east = (
        np.concatenate((part, (part @ weight + extra)[:, :, None]), axis=2)
        for part, extra in zip((ensemble.north, ensemble.east), more, strict=True)
    )
    lat, lon = np.append(ensemble.site_lat, here[0]), np.append(ensemble.site_lon, here[1])
    return replace(ensemble, site_lat=lat, site_lon=lon, north=north, east=east)


def worth(weights: NDArray[np.float64]) -> float:
    """Return the effective number of equal weights: (sum w)^2 / sum w^2 (L. Kish, "Survey Sampling", 1965)."""
    return float(weights.sum() ** 2 / (weights**2).sum())


def _flattened(probability: NDArray[np.float64], likelihood: NDArray[np.float64], least: float) -> NDArray[np.float64]:
    """Return the greatest power of likelihoods, at most 1, with which the effective number of members is at least the given one."""
    if worth(probability * likelihood) >= min(least, worth(probability)):
        return likelihood
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        power = 0.5 * (low + high)
        low, high = (power, high) if worth(probability * likelihood**power) >= least else (low, power)
    return likelihood**low
