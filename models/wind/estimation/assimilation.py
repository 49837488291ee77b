"""Winds measured by drones across a region, assimilated into a forecast: an ensemble Kalman filter.

The correlation of the forecast error at one place and hour with that at others follows from its members: through their covariance one measurement updates the
rest. So winds of a season's days are correlated over the whole region, and the courses of a weather service over the scales of the learnt error. Each member is
moved by its own distance from the measurement, which is perturbed for each within its error, so that the remaining spread is correct.

The wind at a drone differs from the forecast by the gusts in it, and by variation within a few kilometres that no forecast resolves
(`models.wind.field_error`): that is correlated in space and time, so that twenty drones in one valley count little more than one.

Sources: G. Evensen, "Sequential data assimilation with a nonlinear quasi-geostrophic model using Monte Carlo methods", J. Geophys. Res. 99 (1994), 10143-10162; G. Burgers,
P. J. van Leeuwen and G. Evensen, "Analysis Scheme in the Ensemble Kalman Filter", Mon. Wea. Rev. 126 (1998), 1719-1724 (perturbed measurements).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.geodesy import inverse
from skyway.models.wind.estimation.field import check_observations, noise_covariance, places
from skyway.models.wind.estimation.forecast_update import SLOT_S, refined, update_forecast

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.models.wind.estimation.field import ResidualModel, WindObservation
    from skyway.models.wind.field_error import FieldError

LEAST_MEMBERS = 10
"""With fewer members the covariance of winds is not usable."""
LOCAL_M = 15_000.0
"""Time over which the unresolved variation fades."""
SEED = 1994


def assimilated(
    ensemble: WindEnsemble,
    observations: Sequence[WindObservation],
    field: FieldError,
    residual: ResidualModel,
    *,
    slot_s: float = SLOT_S,
    least_members: float = 1.0,
) -> WindEnsemble:
    """Move the members of a forecast by measurements; they keep their probabilities.

    The ensemble and `field` are at the height of the observations, which are averages over slots. A forecast of fewer than `LEAST_MEMBERS` members is
    updated by `residual` and `least_members` (`update_forecast`).
    """
    if not observations:
        return ensemble
    check_observations(observations)
    if len(ensemble) < LEAST_MEMBERS:
        return update_forecast(ensemble, observations, residual, slot_s=slot_s, least_members=least_members)
    time_s, lat, lon = places(observations)
    told = np.array([(one.north_mps, one.east_mps) for one in observations]).T.ravel()
    expected = np.concatenate(
        ensemble.at_times(lat, lon, time_s), axis=1
    )  # (members, both components of all observations)
    off = expected - ensemble.probability @ expected
    weighted = off * ensemble.probability[:, None]
    sill = field.variance * float(field.in_wind(np.hypot(*told.reshape(2, -1)).mean()))

    def local(
        at_s: NDArray[np.float64], at_lat: NDArray[np.float64], at_lon: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Covariance of the unresolved variation, of places and times with the observations."""
        distance_m, _ = inverse(at_lat[:, None], at_lon[:, None], lat[None], lon[None])
        return np.asarray(sill * np.exp(-distance_m / LOCAL_M - np.abs(at_s[:, None] - time_s) / field.tau_s))

    noise = np.kron(np.eye(2), noise_covariance(observations) + local(time_s, lat, lon))
    drawn = np.random.default_rng(SEED).standard_normal(off.shape) @ np.linalg.cholesky(noise).T
    drawn -= ensemble.probability @ drawn
    pressed = np.linalg.solve(off.T @ weighted + noise, (told + drawn - expected).T)  # (observations, members)
    fine = refined(ensemble, slot_s)
    begin, latest = fine.start_s + np.arange(fine.slots) * fine.slot_s, float(time_s.max())
    middle = np.where(begin <= latest, np.minimum(begin + fine.slot_s / 2.0, latest), begin + fine.slot_s / 2.0)
    sites = len(fine.site_lat)
    near = local(np.repeat(middle, sites), np.tile(fine.site_lat, fine.slots), np.tile(fine.site_lon, fine.slots))
    moved = []
    # of each member, in two steps: sum over members of (X - mean) (weighted' pressed), and what is local
    shared = weighted @ pressed
    for part, values in enumerate((fine.north, fine.east)):
        away = (values - np.einsum("m,mts->ts", fine.probability, values)).reshape(len(fine), -1)
        rows = slice(part * len(time_s), (part + 1) * len(time_s))
        step = away.T @ shared + near @ pressed[rows]
        moved.append(values + step.T.reshape(values.shape))
    return replace(fine, north=moved[0], east=moved[1])
