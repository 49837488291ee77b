"""Reader of a scenario folder: ``scenario.toml`` and the files that it names.

Every part is read even when another is wrong, so that all faults are reported at once.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np

from skyway.models.airspace.airspace import USUAL_DETOUR, USUAL_HEIGHT_MARGIN_M, USUAL_MARGIN_M, Airspace
from skyway.models.airspace.pressure import named_in, split_pressure
from skyway.models.airspace.reading import read_airspace
from skyway.models.base.errors import Fault, InputError, one_line, refuse
from skyway.models.base.fields import Table, read_toml
from skyway.models.base.ranges import kind_faults
from skyway.models.base.units import SPEED_UNITS_MPS
from skyway.models.drones.drone import M200_V2, Drone
from skyway.models.drones.fleet import read_fleet
from skyway.models.drones.weather_limits import read_limits
from skyway.models.flight.clearance import Clearance
from skyway.models.flight.rules import FlightRules
from skyway.models.network.builders import RULES, build_network
from skyway.models.network.files import MAX_PRICE, STATION_FIELDS, read_segments, read_stations
from skyway.models.network.network import Network
from skyway.models.network.station import ConnectionRule
from skyway.models.queues.load import WEEK_H, PadLoad
from skyway.models.queues.load_files import read_load, read_occupancy
from skyway.models.scenario.air import fleet_in_air
from skyway.models.scenario.checks import fit_warnings, position_faults, zone_faults, zone_warnings
from skyway.models.scenario.ground import grounded, over_terrain
from skyway.models.scenario.remote_id import read_remote_id
from skyway.models.scenario.scenario import MAX_NOTES, Scenario
from skyway.models.scenario.tariff import Tariff
from skyway.models.scenario.tariff_files import read_price_record, read_prices
from skyway.models.terrain.files import read_terrain, split_name, with_folder
from skyway.models.wind.columns import WindColumns
from skyway.models.wind.forecast_file import read_forecast_table
from skyway.models.wind.history import WindSite, read_history

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.models.network.station import Station
    from skyway.models.terrain.terrain import Terrain

SCHEMA = "skyway.scenario/1"
FILE = "scenario.toml"
MAX_BYTES = 64 * 1024 * 1024
"""Size limit of any part, checked before it is read."""

T = TypeVar("T")


def read_scenario(path: str | PathLike[str]) -> Scenario:
    """Read the scenario in a folder (or named by its ``scenario.toml``); an `InputError` lists all their faults."""
    remedy = "skyway scenario init DIR writes one to start from"
    refuse(kind_faults("path", path, (str, PathLike), "the folder of a scenario"))
    path = Path(path)
    try:
        file = path / FILE if path.is_dir() or path.suffix != ".toml" else path
        if not file.is_file():
            problem = f"the folder has no {FILE}" if path.is_dir() else "is not a scenario folder"
            problem = problem if path.exists() else "no such folder"
            raise InputError(problem, str(path), remedy=remedy)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", str(path), remedy=remedy) from error
    return _Reader(file).read()


def _clearance(table: Table, default: Clearance) -> Clearance:
    """Read the required clearance over terrain and obstacles."""
    read = Clearance(
        least_m=table.number("least_m", default.least_m, low=1, high=500),
        corridor_width_m=table.number("corridor_width_m", default.corridor_width_m, low=20, high=10_000),
        position_error_m=table.number("position_error_m", default.position_error_m, low=0, high=500),
        max_height_m=table.number("max_height_m", default.max_height_m, low=20, high=10_000),
    )
    table.finish()
    return read


class _Reader:
    """Reads one scenario, collecting faults, warnings and the digest of its files."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.folder = file.parent
        self.faults: list[Fault] = []
        self.warnings: list[str] = []
        self.stations: tuple[Station, ...] = ()
        self.stations_file = ""
        self.own_zones = ""
        self.digest = hashlib.sha256()
        self.top = Table(read_toml(file), str(file), "", self.faults)
        self._add_to_digest(file)

    def read(self) -> Scenario:
        self.top.text("schema", SCHEMA, choices=(SCHEMA,))
        name = self.top.text("name", self.folder.name or "scenario")
        timezone = self._timezone()
        rules = self._rules(self.top.table("flight"))
        terrain = self._terrain()
        network = self._network(self.top.table("network"), self.top.table("airspace"), rules, terrain)
        drones = self._drones(self.top.table("drones"))
        wind = self._wind(self.top.table("wind"))
        if self.stations:
            self.faults += position_faults(self.stations, wind["wind_sites"], self.stations_file, str(self.file))
        load = self._load(self.top.table("load"), network, timezone)
        tariff = self._tariff(self.top.table("costs"), timezone)
        observed = self._observed(self.top.table("observed"))
        remote_id = read_remote_id(self.top.table("remote_id"))
        forecast = self._forecast(self.top.table("forecast"), named=wind["forecast_file"] is not None)
        self.top.finish()
        if self.faults or network is None:
            raise InputError(self.faults)
        self.warnings += fit_warnings(network, wind["wind_sites"])
        scenario = Scenario(
            name=name,
            network=network,
            drones=drones,
            rules=rules,
            load=load if load is not None else PadLoad.none(len(network), timezone),
            tariff=tariff,
            timezone=timezone,
            **wind,
            **observed,
            **forecast,
            remote_id=remote_id,
            path=str(self.file),
            sha256=self.digest.hexdigest(),
            warnings=tuple(self.warnings),
        )
        return fleet_in_air(scenario) if terrain is None else over_terrain(scenario, terrain)

    def _terrain(self) -> Terrain | None:
        """Read the terrain and obstacle files that are named."""
        named: list[list[str]] = []
        for key in ("terrain", "obstacles"):
            found = []
            for text in self.top.texts(key, ()):
                path, said = split_name(text)
                whole = self.folder / path
                if not whole.is_file():
                    self.top.fault(key, "no such file", text)
                    continue
                self._add_to_digest(whole)
                found.append("@".join((str(whole), *with_folder(said, self.folder))))
            named.append(found)
        return self._try(lambda _: read_terrain(*named), self.file) if any(named) else None

    def _timezone(self) -> str:
        name = self.top.text("timezone", "UTC")
        try:
            ZoneInfo(name)
        except (ZoneInfoNotFoundError, ValueError, OSError):
            self.top.fault("timezone", "is not a time zone", name, "an IANA name such as Europe/Berlin")
            return "UTC"
        return name

    def _airspace(self, own: Path | None, table: Table, rules: FlightRules) -> Airspace | None:
        """Read the zones: of one file under [network], and any number under [airspace]."""
        names = enumerate(table.texts("files", ()))
        paths = [path for number, name in names if (path := self._zones(table, f"files[{number}]", name)) is not None]
        usual = (USUAL_MARGIN_M, USUAL_HEIGHT_MARGIN_M, USUAL_DETOUR) if "airspace" in self.top else (0.0, 0.0, 1.0)
        margin_m = table.number("margin_m", usual[0], low=0, high=100_000)
        height_margin_m = table.number("height_margin_m", usual[1], low=0, high=10_000)
        max_detour = table.number("max_detour", usual[2], low=1, high=20)
        max_height_m = table.number("max_height_m", math.inf, above=0)
        authorized = table.texts("authorized", ())
        table.finish()
        if own is None and not paths and math.isinf(max_height_m):
            return None
        before = len(self.faults)
        zones, notes = self._try(lambda _: read_airspace([*filter(None, (own,)), *paths]), self.file) or ((), ())
        if len(self.faults) > before:
            return None
        self.warnings += [str(note) for note in notes[:MAX_NOTES]]
        if len(notes) > MAX_NOTES:
            self.warnings.append(
                f"{len(notes) - MAX_NOTES} more of the airspace was not understood: skyway airspace lists it"
            )
        found = Airspace(
            zones, margin_m, height_margin_m, max_height_m, rules.cruise_height_m, max_detour, frozenset(), notes
        )
        self.own_zones = "" if own is None else str(own)
        return self._try(lambda _: found.with_authorized(authorized), self.file)

    def _network(self, table: Table, airspace: Table, rules: FlightRules, terrain: Terrain | None) -> Network | None:
        stations_file = self._path(table, "stations", required=True)
        segments_file = self._path(table, "segments")
        zones = self._airspace(self._path(table, "zones"), airspace, rules)
        rule = ConnectionRule(
            kind=table.text("rule", "max-length", choices=RULES),
            max_length_m=table.number("max_length_m", 10_000.0, above=0, high=2e7),
            nearest=table.whole("nearest", 6, low=1, high=1000),
        )
        columns_table = table.table("columns")
        columns = {field: name for field in STATION_FIELDS if (name := columns_table.text(field, ""))}
        columns_table.finish()
        pads = table.whole("pads", 5, low=0, high=10_000)
        spots = table.whole("holding_spots", 4, low=0, high=10_000)
        table.finish()
        stations = self._try(lambda f: read_stations(f, columns=columns, pads=pads, holding_spots=spots), stations_file)
        if stations is None:
            return None
        if zones is not None and terrain is not None:  # zones are compared with the ground
            stations = grounded(stations, terrain)
        if zones is not None:
            self.faults += zone_faults(stations, zones, str(stations_file), self.own_zones)
            self.warnings += zone_warnings(stations, zones)
        self.stations, self.stations_file = stations, str(stations_file)
        if segments_file is None:
            return self._try(lambda _: build_network(stations, rule, zones=zones), self.file)
        pairs = self._try(lambda f: read_segments(f, stations), segments_file)
        if pairs is None:
            return None
        network = Network.from_pairs(stations, np.array(pairs, dtype=np.int64).reshape(-1, 2), zones=zones)
        removed = len(set(pairs)) - len(network.tail)
        if removed:
            why = (
                "cross a no-fly zone"
                if zones is None or math.isinf(zones.max_height_m)
                else "cross a no-fly zone, or are too high,"
            )
            self.warnings.append(f"{removed} given segments {why} and are ignored")
        return network

    def _drones(self, table: Table) -> tuple[Drone, ...]:
        file = self._path(table, "fleet")
        table.finish()
        return self._try(read_fleet, file) or (M200_V2,)

    def _rules(self, table: Table) -> FlightRules:
        default = FlightRules()
        rules = FlightRules(
            cruise_height_m=table.number("cruise_height_m", default.cruise_height_m, low=5, high=1000),
            climb_rate_mps=table.number("climb_rate_mps", default.climb_rate_mps, low=0.1, high=30),
            descent_rate_mps=table.number("descent_rate_mps", default.descent_rate_mps, low=0.1, high=30),
            wind_profile_exponent=table.number("wind_profile_exponent", default.wind_profile_exponent, low=0, high=1),
            clearance=_clearance(table.table("clearance"), default.clearance),
            limits=read_limits(self.top.table("limits")),
        )
        table.finish()
        return rules

    def _wind(self, table: Table) -> dict[str, Any]:
        ensemble = table.table("ensemble")
        season_days = ensemble.whole("season_days", 30, low=0, high=183)
        ensemble.finish()
        file = self._path(table, "history")
        forecast_file = self._path(table, "forecast")
        sites, sound = self._sites(table)
        measured_at = table.number("measured_at_m", 10.0, above=0, high=1000)
        fields: dict[str, Any] = {
            "time": table.text("time", "time"),
            "site": table.text("site") if "site" in table else None,
            "speed": table.text("speed", "speed_mps"),
            "from_": table.text("from", "from_deg"),
            "speed_unit": table.text("speed_unit", "m/s", choices=tuple(SPEED_UNITS_MPS)),
            "time_zone": table.text("time_zone") if "time_zone" in table else None,
            "missing": table.texts("missing", ("", "NA", "NaN")),
            "calm": table.text("calm", "speed-0", choices=("direction-0", "speed-0")),
            "variable": table.texts("variable", ("VRB",)),
            "time_format": table.text("time_format") if "time_format" in table else None,
            "default_site": sites[0].id if len(sites) == 1 else None,
        }
        table.finish()
        columns = self._try(lambda _: WindColumns(**fields), self.file)
        parts: dict[str, Any] = {
            "season_days": season_days,
            "wind_sites": sites,
            "measured_at_m": measured_at,
            "forecast_file": forecast_file,
            "history": None,
        }
        if sound and not sites and (file is not None or forecast_file is not None):
            table.fault("sites", "is missing", remedy="give the places of measurement: [[wind.sites]] id, lat, lon")
        if sound and sites:  # the forecast is read on use, but errors in it are reported now
            self._try(lambda f: read_forecast_table(f, [site.id for site in sites]), forecast_file)
        if sound and sites and file is not None and columns is not None:
            history = self._try(lambda f: read_history(f, columns, sites, measured_at), file)
            self.warnings += history.warnings if history is not None else ()
            parts["history"] = history
        return parts

    def _sites(self, table: Table) -> tuple[tuple[WindSite, ...], bool]:
        """Read the places of the wind record, and whether all are sound."""
        before = len(self.faults)
        sites = []
        for part in table.tables("sites"):
            lat, lon = part.number("lat", low=-90, high=90), part.number("lon", low=-180, high=180)
            sites.append(WindSite(part.text("id"), lat, lon, part.text("icao", "")))
            part.finish()
        sound = len(self.faults) == before
        return tuple(sites) if sound else (), sound

    def _observed(self, table: Table) -> dict[str, Any]:
        """Read the sources of current weather and pads; the files change by the hour, and are not part of the scenario."""
        wind = table.texts("wind", ())
        for text in wind:
            if not text.strip() or one_line(text) != text:
                table.fault("wind", "must be names of files", text)
        pads = table.text("pads", "")
        table.finish()
        if pads and not pads.startswith("tcp:"):
            pads = str(self.folder / pads)
        return {"observed_wind": tuple(str(self.folder / text) for text in wind), "observed_pads": pads or None}

    def _forecast(self, table: Table, *, named: bool) -> dict[str, Any]:
        """Read the sources of forecasts; they change by the hour, are read on use, and are not part of the scenario."""
        files, error = table.texts("files", ()), table.text("error", "")
        for text in files:
            if not text.strip() or one_line(text) != text:
                table.fault("files", "must be names of files or folders", text)
        table.finish()
        if files and named:
            table.fault("files", "[wind] names a forecast, too", remedy="keep one of them")
        return {
            "forecast_files": tuple(str(self.folder / text) for text in files),
            "forecast_error": str(self.folder / error) if error else None,
        }

    def _load(self, table: Table, network: Network | None, timezone: str) -> PadLoad | None:
        file = self._path(table, "file")
        occupancy = self._path(table, "occupancy")
        mean_charging_min = table.number("mean_charging_min", 60.0, above=0, high=10_000)
        table.finish()
        if file is not None and occupancy is not None:
            table.fault("occupancy", "file and occupancy are both given", remedy="keep one of them")
        if network is None:
            return None
        real = [station for station in network.stations if not station.flyover]  # they come first
        ids, pads = [station.id for station in real], network.pads[: len(real)]
        if file is not None:
            found = self._try(lambda f: read_load(f, ids, timezone, pads=pads), file)
        elif occupancy is not None:
            found = self._try(lambda f: read_occupancy(f, ids, timezone, pads, mean_charging_min), occupancy)
        else:
            self.warnings.append("no [load]: assuming that no other drones use the pads")
            return None
        if found is None:
            return None
        load, warnings = found
        self.warnings += warnings
        return load.extended(len(network) - len(real)) if len(network) > len(real) else load

    def _tariff(self, table: Table, timezone: str) -> Tariff | None:
        """Read prices of energy and pads; `_network` has read the stations."""
        if "costs" not in self.top:
            return None
        currency = table.text("currency")
        usual = table.number("energy_price_per_kwh", low=0, high=MAX_PRICE)
        fee = table.number("pad_fee", 0.0, low=0, high=MAX_PRICE)
        prices, record = self._path(table, "prices"), self._path(table, "price_record")
        table.finish()
        if prices is not None and record is not None:
            table.fault("price_record", "prices and price_record are both given", remedy="keep one of them")
        ids = [station.id for station in self.stations]
        by_hour = self._try(lambda f: read_prices(f, ids), prices)
        if record is not None:
            by_hour, warnings = self._try(lambda f: read_price_record(f, ids, timezone), record) or (None, [])
            self.warnings += warnings
        if math.isnan(usual):  # reported already
            return None
        of_station = np.array([[usual if (one := s.energy_price_per_kwh) is None else one] for s in self.stations])
        energy = np.broadcast_to(of_station.reshape(-1, 1), (len(ids), WEEK_H))
        if by_hour is not None:
            energy = np.where(np.isnan(by_hour), energy, by_hour)
        fees = np.array([fee if station.pad_fee is None else station.pad_fee for station in self.stations])
        return Tariff(currency, np.ascontiguousarray(energy), fees.astype(np.float64), usual, timezone)

    def _path(self, table: Table, key: str, *, required: bool = False) -> Path | None:
        if not required and key not in table:
            return None
        text = table.text(key)
        return self._named(table, key, text) if text else None

    def _zones(self, table: Table, key: str, text: str) -> Path | None:
        """Path of an airspace file, with the pressure that follows its name."""
        told = Path(named_in(text, self.folder))
        try:
            path, _ = split_pressure(told)
        except InputError as error:
            self.faults += error.faults
            return None
        found = self._named(table, key, text if path == told else str(path.relative_to(self.folder)))
        return None if found is None else told

    def _named(self, table: Table, key: str, text: str) -> Path | None:
        path = self.folder / text
        try:
            if path.is_dir():
                table.fault(key, "is a folder, not a file", text)
            elif not path.is_file():
                table.fault(key, "no such file", text)
            elif path.stat().st_size > MAX_BYTES:
                table.fault(key, f"is larger than {MAX_BYTES / 1e6:.0f} MB", text, "cut it to the part that is needed")
            else:
                self._add_to_digest(path)
                return path
        except OSError as error:
            table.fault(key, f"cannot be read: {error.strerror}", text)
        return None

    def _add_to_digest(self, path: Path) -> None:
        with path.open("rb") as stream:
            self.digest.update(hashlib.file_digest(stream, "sha256").digest())

    def _try(self, read: Callable[[Path], T], path: Path | None) -> T | None:
        """Read a part; its faults join the others."""
        if path is None:
            return None
        try:
            return read(path)
        except InputError as error:
            self.faults += [fault if fault.file else replace(fault, file=str(path)) for fault in error.faults]
            return None
