"""The wind forecast in figures, hour by hour."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo

import numpy as np

from models.units import from_posix, iso
from models.wind import speed_from

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from models.scenario import Scenario
    from models.wind_forecast import WindEnsemble


def over_region(ensemble: WindEnsemble, scenario: Scenario) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(north, east) at cruise height over the middle of the network, shape (members, slots) each."""
    rules = scenario.rules
    wind = ensemble.at_height(rules.cruise_height_m, rules.wind_profile_exponent)
    lat, lon = float(np.mean(scenario.network.lat)), float(np.mean(scenario.network.lon))
    weights = wind.idw_weights(lat, lon, wind.site_lat, wind.site_lon)[0]
    return wind.north @ weights, wind.east @ weights


def quantiles(
    values: NDArray[np.float64], probability: NDArray[np.float64], levels: Sequence[float]
) -> list[NDArray[np.float64]]:
    """Weighted quantiles over the members: the least value at or below which the share lies, shape (slots,) each."""
    order = np.argsort(values, axis=0, kind="stable")
    ranked = np.take_along_axis(values, order, axis=0)
    share = np.cumsum(probability[order], axis=0)
    found = []
    for level in levels:
        row = np.minimum((share < level - 1e-12).sum(axis=0), len(values) - 1)
        found.append(np.take_along_axis(ranked, row[None, :], axis=0)[0])
    return found


def hourly(
    ensemble: WindEnsemble, scenario: Scenario, hours: int, truth: WindEnsemble | None = None
) -> list[dict[str, Any]]:
    """Wind at cruise height over the middle of the network, a row per slot.

    Returns
    -------
    list of dict
        start (ISO 8601), mean_mps, p10_mps, p50_mps, p90_mps, from_deg and steadiness (direction and length of the
        mean vector over mean speed), p_hold by drone (share of members over its wind limit), truth_mps, truth_from_deg.
    """
    north, east = over_region(ensemble, scenario)
    weight = ensemble.probability
    slots = min(north.shape[1], max(1, round(hours * 3600 / ensemble.slot_s)))
    rows = []
    for slot in range(slots):
        speed = np.hypot(north[:, slot], east[:, slot])
        low, middle, high = (float(q[0]) for q in quantiles(speed[:, None], weight, (0.1, 0.5, 0.9)))
        length, direction = speed_from(weight @ north[:, slot], weight @ east[:, slot])
        mean = float(weight @ speed)
        row: dict[str, Any] = {
            "start": iso(from_posix(ensemble.start_s + slot * ensemble.slot_s)),
            "mean_mps": mean,
            "p10_mps": low,
            "p50_mps": middle,
            "p90_mps": high,
            "from_deg": float(direction),
            "steadiness": float(length) / mean if mean > 0 else 1.0,
            "p_hold": {d.id: float(weight @ (speed > d.wind_limit_mps)) for d in scenario.drones},
        }
        if truth is not None:
            true_north, true_east = over_region(truth, scenario)
            true_speed, true_from = speed_from(true_north[0, slot], true_east[0, slot])
            row |= {"truth_mps": float(true_speed), "truth_from_deg": float(true_from)}
        rows.append(row)
    return rows


def print_wind(rows: list[dict[str, Any]], ensemble: WindEnsemble, scenario: Scenario) -> None:
    """Print the rows as a table."""
    from datetime import datetime

    from rich import box
    from rich.table import Table

    from skyway.cli.tables import console, percent, print_table, say

    zone = ZoneInfo(scenario.timezone)
    out = console()
    days = f"{ensemble.labels[0]} … {ensemble.labels[-1]}" if len(ensemble.labels) > 1 else ensemble.labels[0]
    courses = "one course" if len(ensemble.labels) == 1 else f"{len(ensemble.labels)} possible courses"
    say(out, f"{courses} of the wind ({days}), at {scenario.rules.cruise_height_m:g} m over the middle of the network")
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1))
    names = ["hour", "mean m/s", "p10", "p50", "p90", "mean from", "steadiness"]
    names += [f"hold {drone.id}" for drone in scenario.drones]
    if "truth_mps" in rows[0]:
        names.append("truth")
    for name in names:
        table.add_column(name, justify="left" if name == "hour" else "right", no_wrap=True)
    for row in rows:
        local = datetime.fromisoformat(row["start"]).astimezone(zone)
        cells = [
            local.strftime("%a %H:%M"),
            *(f"{row[key]:.1f}" for key in ("mean_mps", "p10_mps", "p50_mps", "p90_mps")),
        ]
        cells += [f"{round(row['from_deg']) % 360:03d}°", f"{row['steadiness']:.2f}"]
        cells += [percent(value) for value in row["p_hold"].values()]
        if "truth_mps" in row:
            cells.append(f"{row['truth_mps']:.1f} from {round(row['truth_from_deg']) % 360:03d}°")
        table.add_row(*cells)
    print_table(out, table)
    say(out, "")
    say(out, "hold: probability that the wind over the middle of the network is above the limit of the drone")
    say(out, "steadiness: length of the mean wind vector over the mean speed; 1 is a wind that never turns")
