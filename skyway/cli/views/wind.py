"""Output of a wind forecast, hour by hour."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from skyway.cli.views.sheet import Column, Sheet, say
from skyway.models.base.formatting import percent, weekday_clock
from skyway.models.wind.summary import Wind

if TYPE_CHECKING:
    from skyway.models.scenario.scenario import Scenario
    from skyway.plots.wind_summary import WindReport


def print_wind(report: WindReport, scenario: Scenario) -> None:
    """Print the hours as a table."""
    zone, members = ZoneInfo(scenario.timezone), report.members
    days = f"{members[0]} … {members[-1]}" if len(members) > 1 else members[0]
    count = "one wind" if len(members) == 1 else f"{len(members)} possible winds"
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
    truth = isinstance(report.hours[0].truth_mps, float)
    sheet = Sheet([*columns, *([Column("truth", justify="left")] if truth else [])])
    for row in report.hours:
        wind = Wind(row.mean_mps, row.from_deg, row.p10_mps, row.p90_mps)
        cells = [
            weekday_clock(datetime.fromisoformat(row.start), zone),
            wind.range_text,
            wind.direction_text,
            percent(row.sector_share),
        ]
        cells += [percent(value) for value in row.p_hold.values()]
        if isinstance(row.truth_mps, float) and isinstance(row.truth_from_deg, float):
            cells.append(str(Wind(row.truth_mps, row.truth_from_deg)))
        sheet.add(*cells)
    sheet.show()
    say("")
    say(
        'wind: mean and 80 % range of the speed; from: prevailing direction, "variable" if no sector of 90° holds half of the'
    )
    say("winds; within 45°: share of the winds from there")
    say("over: probability of a wind above the limit of a drone, which then holds on the ground")
