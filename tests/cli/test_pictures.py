"""Pictures and GeoJSON of a region that lies across the antimeridian, and what a picture of a plan shows."""

import csv
import itertools
import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from skyway.missions.examples import NEW_YORK
from skyway.planner.schedule.schedule_kernels import (
    COLUMNS,
    PAD,
    READY,
    SOC_LANDING,
    SOC_TAKE_OFF,
    TAKE_OFF,
    TOUCH_DOWN,
)
from skyway.plots.charge_band import band_of

EAST = 180.0 - -73.95
PLAN = ("--from", "bellevue", "--to", "jacobi", "--payload", "0.8", "--drone", "m200", "--planner", "pfs-charge-aware",
        "--depart", "2013-07-10T14:00-04:00")  # fmt: skip


def moved(lon):
    return (float(lon) + EAST + 180.0) % 360.0 - 180.0


@pytest.fixture
def fiji(tmp_path):
    """New York, moved so that the antimeridian runs through Manhattan; what is as heavy as its record is linked."""
    folder = tmp_path / "fiji"
    shutil.copytree(NEW_YORK, folder)
    rows = list(csv.DictReader((folder / "stations.csv").read_text().splitlines()))
    with (folder / "stations.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0].keys())
        writer.writeheader()
        writer.writerows(row | {"lon": f"{moved(row['lon']):.6f}"} for row in rows)
    settings = (folder / "scenario.toml").read_text()
    settings = re.sub(r"lon = (-7\d\.\d+)", lambda found: f"lon = {moved(found[1]):.4f}", settings)
    (folder / "scenario.toml").write_text(re.sub(r"zones = .*", "", settings))
    return folder


def lines_of(document):
    for feature in document["features"]:
        geometry = feature["geometry"]
        if geometry["type"] != "Point":
            parts = geometry["coordinates"]
            yield feature, parts if geometry["type"] == "MultiLineString" else [parts]


def test_a_plan_across_the_antimeridian_is_drawn_about_its_middle_and_its_lines_are_cut(skyway, fiji, tmp_path):
    pytest.importorskip("matplotlib")
    answer = skyway("plan", fiji, *PLAN, "--plot", "p.svg", "--geojson", "p.geojson")
    assert answer.code == 0, answer.err
    document = json.loads((tmp_path / "p.geojson").read_text())
    cut = 0
    for _, parts in lines_of(document):
        cut += len(parts) > 1
        for part in parts:
            lon = [position[0] for position in part]
            assert max(lon) - min(lon) < 1.0
            assert all(-180.0 <= value <= 180.0 for value in lon)
        assert all(abs(one[-1][0]) == 180.0 == abs(two[0][0]) for one, two in itertools.pairwise(parts))
    assert cut
    assert [feature["properties"]["leg"] for feature, _ in lines_of(document)] == list(
        range(1, 1 + sum(1 for _ in lines_of(document)))
    )
    text = (tmp_path / "p.svg").read_text()
    drawn = [float(value) for value in re.findall(r"<!-- ([\d.]+)° [EW] -->", text)]
    assert drawn
    assert all(179.0 < value <= 180.0 for value in drawn)


def test_a_network_across_the_antimeridian_comes_back_from_its_geojson_as_it_was(skyway, fiji, tmp_path):
    pytest.importorskip("matplotlib")
    from skyway.models.network.files import read_segments, read_stations
    from skyway.models.scenario.file import read_scenario

    assert skyway("network", fiji, "--plot", "n.svg", "--geojson", "n.geojson").code == 0
    network = read_scenario(fiji).network
    stations = read_stations(tmp_path / "n.geojson")
    assert [s.id for s in stations] == [s.id for s in network.stations]
    pairs = set(read_segments(tmp_path / "n.geojson", stations))
    assert pairs == set(zip(network.tail.tolist(), network.head.tolist(), strict=True))
    drawn = [float(value) for value in re.findall(r"<!-- ([\d.]+)° [EW] -->", (tmp_path / "n.svg").read_text())]
    assert drawn
    assert all(value > 179.0 for value in drawn)


def test_a_picture_of_a_plan_says_what_is_expected_when_in_which_zone_and_names_the_diverts(skyway, tmp_path):
    pytest.importorskip("matplotlib")
    assert skyway("plan", *PLAN, "--plot", "p.svg", "-o", "p.json").code == 0
    text = (tmp_path / "p.svg").read_text()
    plan = json.loads((tmp_path / "p.json").read_text())
    said = " ".join(re.findall(r"<!-- (.*?) -->", text, re.DOTALL))
    for word in ("on average", "95 % by", "time of day, EDT", "divert station", "typical schedule", "8 of 10 simulated deliveries",
                 "14:00", "reserve, 20 %"):  # fmt: skip
        assert word in said, word
    diverts = {name for leg in plan["legs"] for name in leg["diverts"]} - {
        name for leg in plan["legs"] for name in (leg["from"], leg["to"])
    }
    assert diverts
    assert all(f"{name} (divert)" in said for name in diverts - set().union(*(leg["via"] for leg in plan["legs"])))


def test_the_band_of_the_charge_holds_eight_of_ten_runs():
    """The oracle is a count, run by run, on runs whose charge is known at any time: they differ only in when they leave."""
    runs = np.empty((101, 1, COLUMNS))
    delay = np.arange(101.0)
    runs[:, 0, PAD] = 0.0
    runs[:, 0, READY] = delay
    runs[:, 0, TAKE_OFF], runs[:, 0, TOUCH_DOWN] = delay, delay + 1000.0
    runs[:, 0, SOC_TAKE_OFF], runs[:, 0, SOC_LANDING] = 1.0, 0.0
    band = band_of(runs, np.full(101, 1.0 / 101), 0.0, 1.0)
    for time_s, low, high in zip(band.time_s, band.low, band.high, strict=True):
        charge = np.clip(1.0 - (time_s - delay) / 1000.0, 0.0, 1.0)[delay + 1000.0 >= time_s]
        inside = np.mean((charge >= low - 0.012) & (charge <= high + 0.012))
        assert inside >= 0.8
    late = replace(band, low=band.low[-1:])
    assert len(late.low) == 1
    assert band.time_s[-1] >= 1000.0
