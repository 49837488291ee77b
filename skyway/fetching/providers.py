"""Services of weather forecasts: their requests and their licences.

Interfaces: open-meteo.com/en/docs and /docs/ensemble-api; registry.opendata.aws/noaa-hrrr-pds, /noaa-gfs-bdp-pds and /noaa-gefs; ECMWF open data
(confluence.ecmwf.int/display/DAC); aviationweather.gov/data/api.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING
from urllib.parse import urlencode

import msgspec
import numpy as np

from skyway.fetching.client import NotThereError
from skyway.fetching.index import ecmwf_spans, ncep_spans
from skyway.models.base.errors import InputError, LinkError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.fetching.client import Client
    from skyway.models.weather.weather import Box

NOAA = "data of NOAA: in the public domain; it asks to be named as the source"
OPEN_METEO = "data of Open-Meteo.com: CC BY 4.0, name it as the source; without --api-key the service is for non-commercial use only"
ECMWF = "data of ECMWF: CC BY 4.0, name it as the source"
HEIGHTS_M = (10, 80, 120)
MOST_POINTS = 4
"""Of Open-Meteo, along each side of the region."""
POINT_DEG = 0.1
"""Distance of its points, at least."""
WIND_NCEP = re.compile(
    r"(?:UGRD|VGRD):(?:10|20|30|40|50|80|100) m above ground|GUST:surface|TMP:2 m above ground|VIS:surface|PRATE:surface"
)
WIND_ECMWF = ("10u", "10v", "100u", "100v", "10fg", "2t")


@dataclass(frozen=True, slots=True)
class Wanted:
    """Request for a forecast."""

    box: Box
    begin: datetime
    hours: int
    stations: tuple[str, ...] = ()
    """Identifiers of aerodromes."""
    api_key: str | None = None


@dataclass(frozen=True, slots=True)
class Provider:
    """One service."""

    name: str
    about: str
    licence: str
    server: str
    suffix: str
    """Of the file that is written."""
    fetch: Callable[[Client, Wanted, str], bytes]
    """(client, what, server) to the content of the file."""


def open_meteo(client: Client, wanted: Wanted, server: str) -> bytes:
    """Fetch a deterministic forecast for points over the region."""
    return _open_meteo(client, wanted, f"{server}/v1/forecast", {}, HEIGHTS_M)


def open_meteo_ensemble(client: Client, wanted: Wanted, server: str) -> bytes:
    """Fetch an ensemble for points over the region."""
    return _open_meteo(client, wanted, f"{server}/v1/ensemble", {"models": "gfs025"}, (10, 80, 100))


def _open_meteo(client: Client, wanted: Wanted, url: str, more: dict[str, str], heights_m: Sequence[int]) -> bytes:
    box = wanted.box
    lats, lons = (
        np.linspace(low, high, min(math.ceil((high - low) / POINT_DEG) + 1, MOST_POINTS))
        if high > low
        else np.array([low])
        for low, high in ((box.south, box.north), (box.west, box.east))
    )
    points = [(lat, (lon + 180.0) % 360.0 - 180.0) for lat in lats for lon in lons]
    winds = [f"wind_{part}_{height}m" for height in heights_m for part in ("speed", "direction")]
    begin = wanted.begin.replace(minute=0, second=0, microsecond=0)
    asked = {
        "latitude": ",".join(f"{lat:.4f}" for lat, _ in points),
        "longitude": ",".join(f"{lon:.4f}" for _, lon in points),
        "hourly": ",".join([*winds, "wind_gusts_10m", "temperature_2m", "precipitation", "visibility"]),
        "wind_speed_unit": "ms",
        "timezone": "GMT",
        "start_hour": f"{begin:%Y-%m-%dT%H:%M}",
        "end_hour": f"{begin + timedelta(hours=wanted.hours + 1):%Y-%m-%dT%H:%M}",
        **more,
    }
    if wanted.api_key:
        asked["apikey"] = wanted.api_key
    data = client.get(f"{url}?{urlencode(asked, safe=',:')}")
    try:
        msgspec.json.decode(data)
    except msgspec.DecodeError as error:
        raise LinkError(f"{url}: the answer is not JSON: {error}") from error
    return data


def _from_ncep(
    client: Client,
    wanted: Wanted,
    cycle_h: int,
    latest_h: int,
    steps: Callable[[datetime, int], list[int]],
    url: Callable[[datetime, int], Sequence[str]],
) -> bytes:
    """Fetch the fields of the newest cycle that has all the steps wanted, by the byte ranges of its indexes."""
    wants = wanted.begin + timedelta(hours=wanted.hours)
    newest = min(wanted.begin, datetime.now(UTC))
    newest = newest.replace(hour=newest.hour - newest.hour % cycle_h, minute=0, second=0, microsecond=0)
    missing: NotThereError | None = None
    for back in range(latest_h // cycle_h + 1):
        issue = newest - timedelta(hours=back * cycle_h)
        leads = steps(issue, math.ceil((wants - issue).total_seconds() / 3600.0))
        first = math.floor((wanted.begin - issue).total_seconds() / 3600.0)
        chosen = [
            lead
            for number, lead in enumerate(leads)
            if lead >= first or (number + 1 < len(leads) and leads[number + 1] > first)
        ]
        try:
            if chosen:
                client.get(url(issue, chosen[-1])[-1] + ".idx", keeps=True)  # what is published last
        except NotThereError as error:
            missing = error
            continue
        if chosen:
            return b"".join(_ranges(client, one) for lead in chosen for one in url(issue, lead))
    raise missing or InputError(
        "no issue has these hours", field="--hours", value=wanted.hours, remedy="fewer hours, or another provider"
    )


def _ranges(client: Client, url: str) -> bytes:
    text = client.get(f"{url}.idx", keeps=True).decode("ascii", "replace")
    return b"".join(
        client.get(url, begin=span.begin, end=span.end, keeps=True)
        for span in ncep_spans(text, WIND_NCEP, f"{url}.idx")
    )


def hrrr(client: Client, wanted: Wanted, server: str) -> bytes:
    """Fetch NOAA's HRRR, 3 km over the contiguous United States: 18 h each hour, 48 h each six hours."""

    def steps(issue: datetime, hours: int) -> list[int]:
        most = 48 if issue.hour % 6 == 0 else 18
        return list(range(hours + 1)) if hours <= most else []

    def url(issue: datetime, lead: int) -> list[str]:
        return [f"{server}/hrrr.{issue:%Y%m%d}/conus/hrrr.t{issue:%H}z.wrfsfcf{lead:02d}.grib2"]

    return _from_ncep(client, wanted, 1, 12, steps, url)


def gfs(client: Client, wanted: Wanted, server: str) -> bytes:
    """Fetch NOAA's GFS, 0.25 degrees over the world, hourly for 120 h."""

    def url(issue: datetime, lead: int) -> list[str]:
        return [f"{server}/gfs.{issue:%Y%m%d}/{issue:%H}/atmos/gfs.t{issue:%H}z.pgrb2.0p25.f{lead:03d}"]

    return _from_ncep(client, wanted, 6, 24, lambda _issue, hours: list(range(min(hours, 120) + 1)), url)


def gefs(client: Client, wanted: Wanted, server: str) -> bytes:
    """Fetch NOAA's ensemble GEFS, 31 members, 0.25 degrees, every 3 h."""
    members = ["c00", *(f"p{number:02d}" for number in range(1, 31))]

    def url(issue: datetime, lead: int) -> list[str]:
        folder = f"{server}/gefs.{issue:%Y%m%d}/{issue:%H}/atmos/pgrb2sp25"
        return [f"{folder}/ge{member}.t{issue:%H}z.pgrb2s.0p25.f{lead:03d}" for member in members]

    return _from_ncep(client, wanted, 6, 24, lambda _issue, hours: list(range(0, min(hours, 240) + 3, 3)), url)


def ifs_ensemble(client: Client, wanted: Wanted, server: str) -> bytes:
    """Fetch ECMWF's open ensemble, 51 members, 0.25 degrees, every 3 h."""
    newest = min(wanted.begin, datetime.now(UTC))
    newest = newest.replace(hour=newest.hour - newest.hour % 12, minute=0, second=0, microsecond=0)
    wants = wanted.begin + timedelta(hours=wanted.hours)
    missing: NotThereError | None = None
    for back in range(4):
        issue = newest - timedelta(hours=12 * back)
        first = math.floor((wanted.begin - issue).total_seconds() / 10_800.0)
        last = math.ceil((wants - issue).total_seconds() / 10_800.0)
        folder = f"{server}/{issue:%Y%m%d}/{issue:%H}z/ifs/0p25/enfo"
        names = [f"{folder}/{issue:%Y%m%d%H}0000-{3 * step}h-enfo-ef" for step in range(first, last + 1)]
        try:
            client.get(f"{names[-1]}.index", keeps=True)
        except NotThereError as error:
            missing = error
            continue
        parts = []
        for name in names:
            text = client.get(f"{name}.index", keeps=True).decode("utf-8", "replace")
            spans = ecmwf_spans(text, WIND_ECMWF, f"{name}.index")
            parts += [client.get(f"{name}.grib2", begin=span.begin, end=span.end, keeps=True) for span in spans]
        return b"".join(parts)
    raise missing or LinkError("the service has no forecast for these hours")


def taf(client: Client, wanted: Wanted, server: str) -> bytes:
    """Fetch the TAFs of the region's aerodromes."""
    if not wanted.stations:
        remedy = "give [[wind.sites]] their identifiers (icao)"
        raise InputError(
            "the scenario has no wind site with an identifier", field="--provider", value="taf", remedy=remedy
        )
    data = client.get(
        f"{server}/api/data/taf?{urlencode({'ids': ','.join(wanted.stations), 'format': 'raw'}, safe=',')}"
    )
    if not data.strip():
        raise LinkError(f"{server}: has no TAF of {', '.join(wanted.stations)}")
    return data


PROVIDERS = {
    one.name: one
    for one in (
        Provider(
            "open-meteo", "the best model for each point", OPEN_METEO, "https://api.open-meteo.com", ".json", open_meteo
        ),
        Provider(
            "open-meteo-ensemble",
            "31 members of GEFS",
            OPEN_METEO,
            "https://ensemble-api.open-meteo.com",
            ".json",
            open_meteo_ensemble,
        ),
        Provider("hrrr", "3 km, United States", NOAA, "https://noaa-hrrr-bdp-pds.s3.amazonaws.com", ".grib2", hrrr),
        Provider("gfs", "0.25°, world", NOAA, "https://noaa-gfs-bdp-pds.s3.amazonaws.com", ".grib2", gfs),
        Provider("gefs", "31 members, 0.25°, world", NOAA, "https://noaa-gefs-pds.s3.amazonaws.com", ".grib2", gefs),
        Provider(
            "ifs-ensemble",
            "51 members, 0.25°, world",
            ECMWF,
            "https://data.ecmwf.int/forecasts",
            ".grib2",
            ifs_ensemble,
        ),
        Provider("taf", "aerodromes of the scenario", NOAA, "https://aviationweather.gov", ".txt", taf),
    )
}
"""Services by their names."""
