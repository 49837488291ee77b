"""Report of an updated forecast, and its output."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import msgspec
import typer

from skyway.models.base.units import from_posix, iso, parse_instant
from skyway.models.base.views import counted
from skyway.models.wind.estimation.forecast_update import MEASURED_S
from skyway.models.wind.summary import Wind

if TYPE_CHECKING:
    from pathlib import Path

    from skyway.cli.commands.forecast import Update
    from skyway.models.wind.ensemble import WindEnsemble

SHOWN_H = (0, 1, 2, 3, 6, 12)


class Measured(msgspec.Struct, frozen=True, kw_only=True):
    """A measured wind, at the height of the sites."""

    t: str
    lat: float
    lon: float
    north_mps: float
    east_mps: float
    sigma_mps: float


class SlotWind(msgspec.Struct, frozen=True, kw_only=True):
    """Wind of an hour (`models.wind.summary`), and the spread of the members about their mean vector."""

    speed_mps: float
    p10_mps: float
    p90_mps: float
    from_deg: float | None
    sigma_mps: float

    @property
    def wind(self) -> Wind:
        """The same without the spread of the vectors."""
        return Wind(self.speed_mps, self.from_deg, self.p10_mps, self.p90_mps)


class SiteWind(SlotWind, frozen=True, kw_only=True):
    """The same at a site, at the height of its instruments, at the departure."""

    site: str


class HourWind(msgspec.Struct, frozen=True, kw_only=True):
    """Wind at the centre of the network, at cruise height, by hours after the departure."""

    hours: int
    before: SlotWind
    after: SlotWind


class ForecastReport(msgspec.Struct, frozen=True, kw_only=True):
    """Result of an update: measured winds, wind at each site, hours before and after, probability of each member."""

    schema: str = "skyway.forecast-update/1"
    depart: str
    height_m: float
    observations: list[Measured]
    field: list[SiteWind]
    hours: list[HourWind]
    members: dict[str, float]


def report_of(update: Update) -> ForecastReport:
    """Compute the report: the measured winds, the wind at each site now, and before and after by hour."""
    return ForecastReport(
        depart=iso(from_posix(round(update.depart_s, 3))),
        height_m=update.before.height_m,
        observations=[
            Measured(
                t=iso(from_posix(round(one.time_s, 3))),
                lat=round(one.lat_deg, 6),
                lon=round(one.lon_deg, 6),
                north_mps=round(one.north_mps, 3),
                east_mps=round(one.east_mps, 3),
                sigma_mps=round(math.sqrt(one.variance), 3),
            )
            for one in update.seen
        ],
        field=_field(update),
        hours=_hours(update),
        members=dict(zip(update.after.labels, update.after.probability.round(6).tolist(), strict=True)),
    )


def _hours(update: Update) -> list[HourWind]:
    from skyway.plots.wind_summary import over_region

    regions = [(one, *over_region(one, update.world)) for one in (update.before, update.after)]
    found = []
    for hour in SHOWN_H:
        time_s = update.depart_s + 3600.0 * hour
        if time_s < update.after.start_s + update.after.slots * update.after.slot_s:
            before, after = (_slot(one, north, east, one.slot_at(time_s)) for one, north, east in regions)
            found.append(HourWind(hours=hour, before=before, after=after))
    return found


def _slot(ensemble: WindEnsemble, north: Any, east: Any, slot: int) -> SlotWind:
    from skyway.models.wind.summary import summary_of

    found = summary_of(north[:, slot], east[:, slot], ensemble.probability)
    off = (north[:, slot] - found.north_mps) ** 2 + (east[:, slot] - found.east_mps) ** 2
    return SlotWind(
        speed_mps=round(found.mean_mps, 3),
        p10_mps=round(found.p10_mps, 3),
        p90_mps=round(found.p90_mps, 3),
        from_deg=None if found.from_deg is None else round(found.from_deg, 1),
        sigma_mps=round(math.sqrt(0.5 * float(ensemble.probability @ off)), 3),
    )


def _field(update: Update) -> list[SiteWind]:
    """Updated wind at each site, at the departure."""
    import numpy as np

    sites = update.world.wind_sites
    after = update.after.at_sites(np.array([one.lat for one in sites]), np.array([one.lon for one in sites]))
    slot = after.slot_at(update.depart_s)
    rows = [_slot(after, after.north[:, :, number], after.east[:, :, number], slot) for number in range(len(sites))]
    return [SiteWind(site=site.id, **msgspec.structs.asdict(row)) for site, row in zip(sites, rows, strict=True)]


def tell(report: ForecastReport, output: Path | None) -> None:
    """Print it."""
    count = len(report.observations)
    what = counted(count, "measurement")
    depart = iso(from_posix(round(parse_instant(report.depart).timestamp())))
    typer.echo(
        f"{counted(len(report.members), 'member')} updated with {what} of {MEASURED_S / 60.0:g} minutes, for {depart}"
    )
    for row in report.field:
        typer.echo(f"  {row.site}: {row.wind} at {report.height_m:g} m")
    typer.echo("  at the centre of the network, at cruise height, before and after:")
    for hour in report.hours:
        typer.echo(f"  +{hour.hours:2d} h: {hour.before.wind}  →  {hour.after.wind}")
    typer.echo("use -o FILE to write it" if output is None else f"written to {output}: skyway plan --forecast {output}")
