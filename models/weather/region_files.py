"""The wind over the region of a scenario from weather files."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError
from skyway.models.base.files import file_error
from skyway.models.base.units import from_posix
from skyway.models.weather.forecasting import check_place, forecast_ensemble
from skyway.models.weather.lead_error import PUBLISHED, read_lead_error
from skyway.models.weather.placing import Placing
from skyway.models.weather.readers.reading import read_weather
from skyway.models.weather.region import Region
from skyway.models.weather.weather import Box
from skyway.models.wind.forecast import read_forecast
from skyway.models.wind.history import WindSite, station_places

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import date, datetime

    from skyway.models.scenario.scenario import Scenario
    from skyway.models.weather.weather import Weather
    from skyway.models.wind.ensemble import WindEnsemble

DAY_S = 86_400.0
_HEAD = 4096


def read_region(
    scenario: Scenario,
    files: Sequence[Path],
    depart: datetime,
    hours: int,
    *,
    error: str | Path | None = None,
    truth: date | None = None,
) -> WindEnsemble:
    """Make the wind over a scenario's region from weather files, see `models.scenario.scenario.Scenario.forecast_from`."""
    paths = listed(files)
    lat, lon = scenario.network.lat, scenario.network.lon
    sites, height_m = scenario.wind_sites, scenario.measured_at_m
    if len(paths) == 1 and is_table(paths[0]):
        if not sites:  # one amid the stations
            sites, height_m = (WindSite("site", float(lat.mean()), float(lon.mean())),), 10.0
        return read_forecast(paths[0], sites, depart, hours, height_m)
    box = Box.around(lat, lon)
    weathers = _read(
        _stamped(paths), box, round(depart.timestamp() / DAY_S) * DAY_S, tuple(station_places(sites).items()), height_m
    )

    def later(begin_s: float, count: int) -> WindEnsemble:
        return scenario.analogues(from_posix(begin_s), count, truth)

    region = Region(
        lat, lon, depart.timestamp(), hours, scenario.rules.cruise_height_m, scenario.rules.wind_profile_exponent,
        later=later if scenario.history is not None else None,
    )  # fmt: skip
    return forecast_ensemble(weathers, region, PUBLISHED if error is None else read_lead_error(Path(error)))


def check_files(scenario: Scenario, files: Sequence[Path], near: datetime) -> None:
    """Raise an `InputError` where weather files cannot provide a forecast for a region at any time."""
    paths = listed(files)
    if len(paths) == 1 and is_table(paths[0]):
        return
    lat, lon, places = scenario.network.lat, scenario.network.lon, tuple(station_places(scenario.wind_sites).items())
    near_s = round(near.timestamp() / DAY_S) * DAY_S
    faults: list[InputError] = []
    weathers = _read(_stamped(paths), Box.around(lat, lon), near_s, places, scenario.measured_at_m)
    for one in weathers:
        try:
            check_place(one, lat, lon)
            Placing(one, lat, lon, Box.around(lat, lon))
        except InputError as error:
            faults.append(error)
    if faults and len(faults) == len(weathers):
        raise InputError([fault for error in faults for fault in error.faults])


def listed(files: Sequence[Path]) -> list[Path]:
    """Return files, with a folder replaced by its files, sorted by name; index and cache files are not weather files."""
    found: list[Path] = []
    for one in files:
        try:
            inside = sorted(path for path in one.iterdir() if path.is_file()) if one.is_dir() else None
        except OSError as failure:
            raise file_error("read", one, failure) from failure
        if inside is None:
            found.append(one)
            continue
        here = [path for path in inside if not path.name.startswith(".") and path.suffix != ".idx"]
        if not here:
            raise InputError("is a folder without files", str(one), remedy="name a weather file, or a folder of them")
        found += here
    return found


def is_table(path: Path) -> bool:
    """Whether a file is a forecast of our own form, by its header; an `InputError` if it is a pipe."""
    if path.is_fifo():  # read more than once
        raise InputError("is a pipe, not a file", str(path), remedy="save the forecast to a file first")
    if path.suffix == ".gz":
        return path.name.endswith(".csv.gz")
    try:
        with path.open("rb") as stream:
            head = stream.read(_HEAD).split(b"\n", 1)[0]
    except OSError:
        return path.suffix == ".csv"
    return b"speed_mps" in head or b"from_deg" in head or path.suffix == ".csv"


def _stamped(paths: Sequence[Path]) -> tuple[tuple[str, int, int], ...]:
    """Each file with its time of change and size, so that an unchanged one is read once."""
    found = []
    for path in paths:
        try:
            told = path.stat()
        except (OSError, ValueError):
            found.append((str(path), 0, 0))
        else:
            found.append((str(path), told.st_mtime_ns, told.st_size))
    return tuple(found)


def forget() -> None:
    """Forget the files read so far."""
    _read.cache_clear()


@lru_cache(maxsize=2)
def _read(
    stamped: tuple[tuple[str, int, int], ...],
    box: Box,
    near_s: float,
    stations: tuple[tuple[str, tuple[float, float]], ...],
    height_m: float,
) -> tuple[Weather, ...]:
    paths = [Path(name) for name, _, _ in stamped]
    return tuple(read_weather(paths, box, near_s=near_s, stations=dict(stations), height_m=height_m))
