"""Figures of a wind forecast, hour by hour."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base.geodesy import about, middle_longitude, wrapped
from skyway.models.base.units import from_posix, iso
from skyway.models.base.weighted import weighted_quantile
from skyway.models.wind.interpolation import idw_weights
from skyway.models.wind.summary import summary_of
from skyway.models.wind.triangle import speed_from

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble


def over_region(ensemble: WindEnsemble, scenario: Scenario) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(north, east) at cruise height at the centre of the network, shape (members, slots) each."""
    rules = scenario.rules
    wind = ensemble.at_height(rules.cruise_height_m, rules.wind_profile_exponent)
    network = scenario.network
    lon = wrapped(float(np.mean(about(network.lon, middle_longitude(network.lon)))))
    weights = idw_weights(float(np.mean(network.lat)), lon, wind.site_lat, wind.site_lon)[0]
    return wind.north @ weights, wind.east @ weights


def hourly(
    ensemble: WindEnsemble, scenario: Scenario, hours: int, truth: WindEnsemble | None = None
) -> list[dict[str, Any]]:
    """Wind at cruise height at the centre of the network, a row per slot; see `models.wind.summary`.

    Returns
    -------
    list of dict
        start (ISO 8601), mean_mps, p10_mps, p50_mps, p90_mps, from_deg (prevailing; None is variable), sector_share
        (share of the winds within the 90 degrees about it), steadiness (length of the mean vector over mean speed),
        p_hold by drone (share of members over its wind limit), truth_mps, truth_from_deg.
    """
    north, east = over_region(ensemble, scenario)
    weight = ensemble.probability
    slots = min(north.shape[1], max(1, round(hours * 3600 / ensemble.slot_s)))
    true_north, true_east = over_region(truth, scenario) if truth is not None else (north, east)
    rows = []
    for slot in range(slots):
        found = summary_of(north[:, slot], east[:, slot], weight)
        speed = np.hypot(north[:, slot], east[:, slot])
        length = float(np.hypot(found.north_mps, found.east_mps))
        row: dict[str, Any] = {
            "start": iso(from_posix(ensemble.start_s + slot * ensemble.slot_s)),
            "mean_mps": found.mean_mps,
            "p10_mps": found.p10_mps,
            "p50_mps": weighted_quantile(speed, weight, 0.5),
            "p90_mps": found.p90_mps,
            "from_deg": found.from_deg,
            "sector_share": found.sector_share,
            "steadiness": length / found.mean_mps if found.mean_mps > 0 else 1.0,
            "p_hold": {d.id: float(weight @ (speed > d.wind_limit_mps)) for d in scenario.drones},
        }
        if truth is not None:
            true_speed, true_from = speed_from(true_north[0, slot], true_east[0, slot])
            row |= {"truth_mps": float(true_speed), "truth_from_deg": float(true_from)}
        rows.append(row)
    return rows
