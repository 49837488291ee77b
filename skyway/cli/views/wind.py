"""Output of a wind forecast, hour by hour."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo

from skyway.cli.views.sheet import Column, Sheet, say
from skyway.models.base.formatting import percent, weekday_clock
from skyway.models.composition.composition import Wind

if TYPE_CHECKING:
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble


def print_wind(rows: list[dict[str, Any]], ensemble: WindEnsemble, scenario: Scenario) -> None:
    """Print the rows of `skyway.plots.wind_summary.hourly` as a table."""
    zone = ZoneInfo(scenario.timezone)
    days = f"{ensemble.labels[0]} … {ensemble.labels[-1]}" if len(ensemble.labels) > 1 else ensemble.labels[0]
    count = "one wind" if len(ensemble.labels) == 1 else f"{len(ensemble.labels)} possible winds"
    say(f"{count} ({days}), at {scenario.rules.cruise_height_m:g} m at the centre of the network")
    columns = [Column("hour", justify="left"), Column("wind", "m/s"), Column("from"), Column("within 45°")]
    columns += [
        Column(
            f"over {drone.wind_limit_mps:g}",
            drone.id,
            words=f"over the {drone.wind_limit_mps:g} m/s of {drone.id} {{}}",
        )
        for drone in scenario.drones
    ]
    truth = "truth_mps" in rows[0]
    sheet = Sheet([*columns, *([Column("truth", justify="left")] if truth else [])])
    for row in rows:
        wind = Wind(row["mean_mps"], row["from_deg"], row["p10_mps"], row["p90_mps"])
        cells = [
            weekday_clock(datetime.fromisoformat(row["start"]), zone),
            wind.range_text,
            wind.direction_text,
            percent(row["sector_share"]),
        ]
        cells += [percent(value) for value in row["p_hold"].values()]
        if truth:
            cells.append(str(Wind(row["truth_mps"], row["truth_from_deg"])))
        sheet.add(*cells)
    sheet.show()
    say("")
    say(
        'wind: mean and 80 % range of the speed; from: prevailing direction, "variable" if no sector of 90° holds half of the'
    )
    say("winds; within 45°: share of the winds from there")
    say("over: probability of a wind above the limit of a drone, which then holds on the ground")
