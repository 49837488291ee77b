"""Figures of a wind forecast, hour by hour."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np

from skyway.models.base.geodesy import about, middle_longitude, wrapped
from skyway.models.base.statistics import weighted_quantile
from skyway.models.base.units import from_posix, iso
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
    weights = wind.weights(float(np.mean(network.lat)), lon)[0]
    return wind.north @ weights, wind.east @ weights


class WindHour(msgspec.Struct, frozen=True, kw_only=True):
    """Wind of one slot, over the members; see `models.wind.summary`."""

    start: str
    """ISO 8601."""
    mean_mps: float
    p10_mps: float
    p50_mps: float
    p90_mps: float
    from_deg: float | None
    """Prevailing direction; None is variable."""
    sector_share: float
    """Share of the winds within the 90 degrees about it."""
    steadiness: float
    """Length of the mean vector over the mean speed."""
    p_hold: dict[str, float]
    """Share of the members over the wind limit of each drone."""
    truth_mps: float | msgspec.UnsetType = msgspec.UNSET
    truth_from_deg: float | msgspec.UnsetType = msgspec.UNSET
    """Wind that blew, where that is known."""


class WindReport(msgspec.Struct, frozen=True, kw_only=True):
    """Wind at cruise height at the centre of the network, hour by hour."""

    schema: str = "skyway.wind/1"
    members: tuple[str, ...]
    hours: list[WindHour]


def wind_report(
    ensemble: WindEnsemble, scenario: Scenario, hours: int, truth: WindEnsemble | None = None
) -> WindReport:
    """Summarize an ensemble slot by slot, beside the wind that blew where that is known."""
    north, east = over_region(ensemble, scenario)
    slots = min(north.shape[1], max(1, round(hours * 3600 / ensemble.slot_s)))
    true = over_region(truth, scenario) if truth is not None else None
    rows = []
    for slot in range(slots):
        row = _hour(ensemble, scenario, slot, north[:, slot], east[:, slot])
        if true is not None:
            speed, from_deg = speed_from(true[0][0, slot], true[1][0, slot])
            row = msgspec.structs.replace(row, truth_mps=float(speed), truth_from_deg=float(from_deg))
        rows.append(row)
    return WindReport(members=ensemble.labels, hours=rows)


def _hour(
    ensemble: WindEnsemble, scenario: Scenario, slot: int, north: NDArray[np.float64], east: NDArray[np.float64]
) -> WindHour:
    weight, speed = ensemble.probability, np.hypot(north, east)
    found = summary_of(north, east, weight)
    length = float(np.hypot(found.north_mps, found.east_mps))
    return WindHour(
        start=iso(from_posix(ensemble.start_s + slot * ensemble.slot_s)),
        mean_mps=found.mean_mps,
        p10_mps=found.p10_mps,
        p50_mps=weighted_quantile(speed, weight, 0.5),
        p90_mps=found.p90_mps,
        from_deg=found.from_deg,
        sector_share=found.sector_share,
        steadiness=length / found.mean_mps if found.mean_mps > 0 else 1.0,
        p_hold={drone.id: float(weight @ (speed > drone.wind_limit_mps)) for drone in scenario.drones},
    )
