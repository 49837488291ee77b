"""Scenarios: all data of a region before a request."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from skyway.models.airspace.airspace import Airspace
from skyway.models.airspace.reading import read_airspace
from skyway.models.base import views
from skyway.models.base.errors import InputError, refuse
from skyway.models.base.units import utc
from skyway.models.network.builders import with_zones
from skyway.models.scenario.checks import zone_faults
from skyway.models.scenario.remote_id import NOBODY, RemoteId
from skyway.models.wind.field_error import FieldError
from skyway.models.wind.forecast import analogue_ensemble, read_forecast, truth_series
from skyway.models.wind.triangle import height_factor

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import date, datetime

    from skyway.models.drones.drone import Drone
    from skyway.models.flight.rules import FlightRules
    from skyway.models.network.network import Network
    from skyway.models.queues.load import PadLoad
    from skyway.models.scenario.tariff import Tariff
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.models.wind.history import WindHistory, WindSite

MAX_NOTES = 20
"""At most this many notes on airspace files are warnings of the scenario."""


@dataclass(frozen=True)
class Scenario:
    """Network, fleet, flight rules, wind record and pad load of a region.

    Attributes
    ----------
    name : str
        Name for people.
    network : Network
        Stations and segments.
    drones : tuple of Drone
        The fleet.
    rules : FlightRules
        How every flight is flown.
    load : PadLoad
        Other drones at the stations, in the order of the network's stations.
    history : WindHistory or None
        Wind record that ensembles are drawn from.
    wind_sites : tuple of WindSite
        Sites at which the wind is measured or forecast.
    measured_at_m : float
        Height of those winds above ground.
    forecast_file : Path or None
        Forecast that is used instead of analogue days.
    forecast_files : tuple of str
        Weather files, of any form, that are used instead of analogue days.
    forecast_error : str or None
        File with the error of these forecasts by lead time (``skyway weather verify``).
    tariff : Tariff or None
        Prices of energy and pads, for the stations that the network begins with; None without costs.
    timezone : str
        IANA name of local time.
    season_days : int
        Days of the record within this many days of the departure's date are analogues.
    observed_wind : tuple of str
        Files with current winds, used by default for plans for now.
    observed_pads : str or None
        Pad service ``tcp:HOST:PORT``, or a file, with the pads that are busy now; likewise.
    remote_id : RemoteId
        Operator data for Remote ID.
    path, sha256 : str or None
        Its path, and the digest of all its files.
    warnings : tuple of str
        Warnings on the input, for a person.
    """

    name: str
    network: Network
    drones: tuple[Drone, ...]
    rules: FlightRules
    load: PadLoad
    history: WindHistory | None = None
    wind_sites: tuple[WindSite, ...] = ()
    measured_at_m: float = 10.0
    forecast_file: Path | None = None
    forecast_files: tuple[str, ...] = ()
    forecast_error: str | None = None
    tariff: Tariff | None = None
    timezone: str = "UTC"
    season_days: int = 30
    observed_wind: tuple[str, ...] = ()
    observed_pads: str | None = None
    remote_id: RemoteId = NOBODY
    path: str | None = None
    sha256: str | None = None
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        if self.history is not None:
            wind = "wind record of " + views.counted(len(self.wind_sites), "site")
        else:
            wind = "forecast file" if self.has_forecast else "no wind record"
        parts = [
            views.counted(len(self.network), "station"),
            views.counted(len(self.network.tail), "segment"),
            views.counted(len(self.drones), "drone"),
            wind,
        ]
        return f"Scenario({self.name}: {', '.join(parts)})"

    def _repr_html_(self) -> str:
        return views.html_table(repr(self), views.station_rows(self.network))

    def drone(self, identity: str) -> Drone:
        """Return a drone of the fleet by id, or raise an `InputError` that names the fleet."""
        for drone in self.drones:
            if drone.id == identity:
                return drone
        fleet = ", ".join(drone.id for drone in self.drones)
        raise InputError("no such drone", field="drone", value=identity, remedy=f"the fleet has {fleet}")

    def forecast(self, depart: datetime, hours: int, *, truth: date | None = None) -> WindEnsemble:
        """Ensemble for a departure: the scenario's forecast, else analogue days of its record.

        The days about `truth` (a local date) are omitted.
        """
        if self.forecast_file is not None:
            return read_forecast(self.forecast_file, self.wind_sites, depart, hours, self.measured_at_m)
        if self.forecast_files:
            error = self.forecast_error
            return self.forecast_from(
                [Path(one) for one in self.forecast_files], depart, hours, error=error, truth=truth
            )
        return self.analogues(depart, hours, truth)

    @property
    def has_forecast(self) -> bool:
        """Whether it names its own forecasts."""
        return self.forecast_file is not None or bool(self.forecast_files)

    def forecast_from(
        self,
        files: Sequence[Path],
        depart: datetime,
        hours: int,
        *,
        error: str | Path | None = None,
        truth: date | None = None,
    ) -> WindEnsemble:
        """Ensemble for a departure from weather files of any form; a folder means all its files.

        `error` names a file with the error of such forecasts by lead time. Where they end, the record continues them. One file of our own (CSV) is for the
        scenario's wind sites, at the height of their instruments.
        """
        from skyway.models.weather.region_files import read_region

        return read_region(self, files, utc(depart), hours, error=error, truth=truth)

    def analogues(self, depart: datetime, hours: int, truth: date | None = None) -> WindEnsemble:
        """Ensemble of analogue days of the record; the days about `truth` (a local date) are omitted."""
        exclude = () if truth is None else (truth,)
        local = utc(depart).astimezone(ZoneInfo(self.timezone))
        return analogue_ensemble(self._record(), local, hours, season_days=self.season_days, exclude=exclude)

    def truth(self, day: date, depart: datetime, hours: int) -> WindEnsemble:
        """Move the measured winds of the record from that local date on to the departure, as an ensemble of one."""
        return truth_series(self._record(), day, utc(depart).astimezone(ZoneInfo(self.timezone)), hours)

    def with_airspace(self, files: Sequence[Path] = (), authorized: Sequence[str] = ()) -> Scenario:
        """Return the same with the zones of more files, and with authorizations for some zones.

        Parts of the files that were not understood are added to the warnings. An `InputError` describes the problem of a file, or an
        unknown zone.
        """
        if not files and not authorized:
            return self
        network, warnings = self.network, self.warnings
        zones = network.zones or Airspace(cruise_height_m=self.rules.cruise_height_m)
        if files:
            more, notes = read_airspace(files)
            refuse(zone_faults(self.network.stations, Airspace(more), "", ""))
            handed = tuple(dict.fromkeys((*zones.handed, *map(str, files))))
            zones = replace(zones.with_zones(more, notes), handed=handed)
            network = with_zones(network, zones)
            warnings = (*warnings, *(str(note) for note in notes[:MAX_NOTES]))
        load = self.load
        if len(network) != len(self.network):  # other bends around zones, behind the stations
            stations = sum(not station.flyover for station in network.stations)
            load = load.first(stations).extended(len(network) - stations)
        network = replace(network, zones=zones.with_authorized(authorized))
        return replace(self, network=network, load=load, warnings=warnings)

    @cached_property
    def field_error(self) -> FieldError:
        """Error of the interpolated wind at cruise height between the sites, by the record where it has several."""
        found = FieldError() if self.history is None else FieldError.of(self.history)
        rules = self.rules
        return found.at_height(height_factor(rules.cruise_height_m, self.measured_at_m, rules.wind_profile_exponent))

    def with_target(
        self,
        lat: float,
        lon: float,
        *,
        id: str = "target",  # noqa: A002
        kind: str = "delivery target",
    ) -> Scenario:
        """Add a delivery target without pads, or another `kind` of place, to the network."""
        network = self.network.with_target(lat, lon, id=id, kind=kind)
        return replace(self, network=network, load=self.load.extended(len(network) - len(self.network)))

    def _record(self) -> WindHistory:
        if self.history is None:
            remedy = "in Python give plan a forecast=, such as constant_wind(8, 270, …)"
            if self.path is None:
                remedy += ", or build_scenario a history="
            else:
                remedy = f"give [wind] history in scenario.toml, or --wind 8@270, or --forecast FILE; {remedy}"
            raise InputError("the scenario has no wind record", self.path, field="wind.history", remedy=remedy)
        return self.history
