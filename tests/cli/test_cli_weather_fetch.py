"""Forecasts are fetched from a server of our own that answers as the services do, with its faults."""

import json
import re
import threading
from datetime import UTC, datetime
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

import pytest
import weather_files as wf

from skyway.cli.main import main
from skyway.fetching.client import Client, NotThereError
from skyway.fetching.index import ecmwf_spans, ncep_spans
from skyway.fetching.providers import WIND_NCEP
from skyway.models.base.errors import LinkError

DEPART = "2013-07-10T14:30Z"


class Service:
    """Files by path, and what goes wrong with the next requests."""

    def __init__(self):
        self.files, self.faults, self.asked = {}, [], []
        service = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                service.asked.append((self.path, self.headers.get("Range")))
                fault = service.faults.pop(0) if service.faults else None
                if isinstance(fault, int):
                    self.send_response(fault)
                    self.send_header("Retry-After", "7")
                    self.end_headers()
                    return
                answer = service.files.get(urlsplit(self.path).path)
                data = answer(parse_qs(urlsplit(self.path).query)) if callable(answer) else answer
                if data is None:
                    self.send_error(404)
                    return
                span = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range") or "")
                if span:
                    data = data[int(span[1]) : int(span[2]) + 1 if span[2] else None]
                self.send_response(206 if span else 200)
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data[: len(data) // 2] if fault == "cut off" else data)

            def log_message(self, *_):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}"
        threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()


@pytest.fixture
def service(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("skyway.fetching.client.FIRST_WAIT_S", 0.001)
    monkeypatch.setattr("skyway.fetching.client.MAX_WAIT_S", 0.002)
    found = Service()
    yield found
    found.server.shutdown()
    found.server.server_close()


def run(capsys, *words):
    code = main(list(words))
    out, err = capsys.readouterr()
    return code, out, err


def fetch(capsys, service, provider, path, *more):
    words = (
        "weather",
        "fetch",
        "--provider",
        provider,
        "--region",
        "newyork",
        "--hours",
        "2",
        "--depart",
        DEPART,
        "--server",
        service.url,
    )
    return run(capsys, *words, "-o", str(path), *more)


def answer(query):
    assert query["wind_speed_unit"] == ["ms"]
    assert query["start_hour"] == ["2013-07-10T14:00"]
    lats, lons = (query[name][0].split(",") for name in ("latitude", "longitude"))
    names = query["hourly"][0].split(",")
    places = []
    for lat, lon in zip(lats, lons, strict=True):
        columns = {name: [5.0] * 4 for name in names}
        units = {
            name: "m/s"
            if "speed" in name or "gust" in name
            else "°"
            if "direction" in name
            else {"temperature_2m": "°C", "precipitation": "mm", "visibility": "m"}[name]
            for name in names
        }
        places.append(wf.open_meteo(columns, units, hours=4, start="2013-07-10T14:00", lat=float(lat), lon=float(lon)))
    return json.dumps(places).encode()


def test_open_meteo_is_asked_for_points_over_the_region_and_tried_again(capsys, service, tmp_path):
    service.files["/v1/forecast"] = answer
    service.faults = [503, "cut off"]
    path = tmp_path / "a.json"
    code, out, err = fetch(capsys, service, "open-meteo", path)
    assert (code, out) == (0, ""), err
    assert "CC BY 4.0" in err
    assert "non-commercial use only" in err
    assert "3 requests" in err
    assert len(json.loads(path.read_text())) == 16
    code, out, err = run(capsys, "wind", "--depart", DEPART, "--forecast", str(path), "--hours", "2", "--json")
    assert (code, round(json.loads(out)["hours"][0]["from_deg"] / 30)) == (0, 0), err


def hrrr_files(tmp_path, service):
    """Three hours of a HRRR of our own, with an index as NCEP writes it, and fields beside the wind."""
    for lead in (2, 3, 4, 5):
        path = wf.write_grib(
            tmp_path / "h.grib2",
            lambda _m, hour, _z, lat, _lon: (3.0 + hour + 0 * lat, 0 * lat),
            hours=(lead,),
            heights=(10, 80),
            grid="lambert",
        )
        data, lines, begin = path.read_bytes(), [], 0
        for number, name in enumerate(("UGRD:10", "VGRD:10", "UGRD:80", "VGRD:80"), start=2):
            part, height = name.split(":")
            lines.append(f"{number}:{begin + 500}:d=2013071012:{part}:{height} m above ground:{lead} hour fcst:")
            begin = data.index(b"7777GRIB", begin) + 4 if b"7777GRIB" in data[begin:] else len(data)
        index = "\n".join(
            [
                f"1:0:d=2013071012:REFC:entire atmosphere:{lead} hour fcst:",
                *lines,
                f"6:{500 + len(data)}:d=2013071012:TMP:500 mb:{lead} hour fcst:",
            ]
        )
        name = f"/hrrr.20130710/conus/hrrr.t12z.wrfsfcf{lead:02d}.grib2"
        service.files[name] = b"x" * 500 + data + b"y" * 300
        service.files[name + ".idx"] = index.encode() + b"\n"


def test_of_a_hrrr_only_the_wind_is_fetched_and_never_twice(capsys, service, tmp_path):
    hrrr_files(tmp_path, service)
    path = tmp_path / "a.grib2"
    code, _, err = fetch(capsys, service, "hrrr", path)
    assert code == 0, err
    assert "public domain" in err
    ranges = [span for name, span in service.asked if name.endswith("f03.grib2")]
    assert ranges == [
        f"bytes=500-{500 + len(wf.write_grib(tmp_path / 'b.grib2', lambda *a: (3.0 + 0 * a[3], 0 * a[3]), hours=(3,), grid='lambert').read_bytes()) - 1}"
    ]
    assert [name for name, _ in service.asked][:3] == [
        f"/hrrr.20130710/conus/hrrr.t{hour}z.wrfsfcf{lead:02d}.grib2.idx" for hour, lead in ((14, 3), (13, 4), (12, 5))
    ]
    asked = len(service.asked)
    code, out, err = fetch(capsys, service, "hrrr", path, "--force")
    assert code == 0
    assert "from the cache" in err
    assert [one for one in service.asked[asked:] if "t12z" in one[0]] == []
    code, out, _ = run(capsys, "weather", str(path), "--scenario", "newyork", "--json")
    (issue,) = json.loads(out)["issues"]
    assert (issue["issued"], issue["times"][0], len(issue["times"])) == (
        "2013-07-10T12:00:00Z",
        "2013-07-10T14:00:00Z",
        4,
    )


CASES = {
    "too often": ([429] * 5, "open-meteo", 3, r"failed 5 times: HTTP 429"),
    "forbidden": ([403], "open-meteo", 3, r"HTTP 403"),
    "not there": ([], "hrrr", 3, r"wrfsfcf\d\d.grib2.idx: the service does not have it"),
    "unknown": ([], "mars", 2, r"no such provider .*one of open-meteo, .*hrrr"),
    "no tafs": ([], "taf", 3, r"the service does not have it"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_service_that_fails_is_one_line_and_writes_nothing(capsys, service, tmp_path, case):
    service.faults, provider, wanted, said = list(CASES[case][0]), *CASES[case][1:]
    service.files["/v1/forecast"] = answer
    path = tmp_path / "a.out"
    code, out, err = fetch(capsys, service, provider, path)
    assert (code, out, path.exists()) == (wanted, "", False)
    assert re.search(said, err), err
    assert sum("skyway:" in line for line in err.splitlines()) == 1


def test_a_server_that_is_not_there_is_one_line(capsys, service, tmp_path):
    client = Client(sleep=lambda _: None)
    service.server.server_close()
    with pytest.raises(LinkError, match="failed 5 times"):
        client.get("http://127.0.0.1:9/none")
    assert not isinstance(LinkError(""), NotThereError)
    assert client.requests == 5


def test_indexes_give_the_bytes_of_the_wind_and_nothing_else():
    text = "1:0:d=2026071012:REFC:entire atmosphere:anl:\n2.1:400:d=2026071012:UGRD:10 m above ground:anl:\n2.2:400:d=2026071012:VGRD:10 m above ground:anl:\n3:900:d=2026071012:UGRD:250 mb:anl:\n4:950:d=2026071012:GUST:surface:anl:\n"
    assert ncep_spans(text, WIND_NCEP, "u") == [(400, 899), (950, None)]
    rows = [
        {"param": "10u", "levtype": "sfc", "_offset": 10, "_length": 5},
        {"param": "10v", "levtype": "sfc", "_offset": 15, "_length": 5, "number": "3"},
        {"param": "u", "levtype": "pl", "_offset": 30, "_length": 5},
    ]
    assert ecmwf_spans("\n".join(map(json.dumps, rows)), ("10u", "10v"), "u") == [(10, 19)]
    for wrong in ("<html>", "1:x:d", "1:0:d=2026071012:TMP:500 mb:anl:"):
        with pytest.raises(LinkError, match="u: "):
            ncep_spans(wrong, WIND_NCEP, "u")


def test_nothing_is_fetched_unasked(service, monkeypatch, capsys, tmp_path):
    def refuse(*_args, **_more):
        raise AssertionError("a web server was asked")

    monkeypatch.setattr("urllib.request.urlopen", refuse)
    columns = {"wind_speed_80m": [7.0] * 4, "wind_direction_80m": [270] * 4}
    path = wf.write_json(
        tmp_path / "a.json",
        wf.open_meteo(columns, {"wind_speed_80m": "m/s", "wind_direction_80m": "°"}, hours=4, start="2013-07-10T14:00"),
    )
    assert run(capsys, "weather", str(path))[0] == 0
    assert run(capsys, "wind", "--depart", DEPART, "--forecast", str(path), "--hours", "1")[0] == 0
    assert datetime.now(UTC)
