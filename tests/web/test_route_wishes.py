"""Stops that are asked for, and stations and segments to be avoided: what comes out is read from the plan itself."""

from __future__ import annotations

import json
from itertools import pairwise

import pytest

from skyway.cli.main import main
from skyway.models.base.errors import InputError
from skyway.planner.parameters.planner import USUAL
from skyway.planning import Conditions, Delivery, solve

DEPART = "2013-07-10T14:00-04:00"


def _planned(start="siuh-north", to="white-plains", planner="robust", avoid=(), stop_at=()):
    how = Conditions(depart=DEPART, avoid=list(avoid))
    asked = Delivery(start=start, to=to, payload=0.8, drone="m300", stop_at=list(stop_at))
    result = solve(*asked.request(how.loaded(), how.instant), how, planner, time_limit_s=60.0, parameters=USUAL)
    return result.composition


def _flown(plan):
    ways = [(leg.origin, *leg.via, leg.destination) for leg in plan.services]
    return {frozenset(pair) for way in ways for pair in pairwise(way)}


@pytest.mark.parametrize("planner", ["robust", "pfs"])
def test_what_is_avoided_is_neither_landed_at_nor_flown(planner):
    free = _planned(planner=planner)
    station = free.stops[0].station
    segment = next(iter(_flown(_planned(planner=planner, avoid=[station]))))
    plan = _planned(planner=planner, avoid=[station, ":".join(sorted(segment))])
    assert station not in {stop.station for stop in plan.stops}
    assert segment not in _flown(plan)
    assert station not in {name for leg in plan.services for name in leg.diverts}
    assert any("avoided as requested" in note for note in plan.notes)


def test_the_drone_stops_where_it_is_asked_to_in_that_order():
    stops = [stop.station for stop in _planned(stop_at=["jacobi", "yonkers"]).stops]
    assert stops.index("jacobi") < stops.index("yonkers")


def test_asking_for_a_stop_that_is_made_anyway_costs_little():
    free = _planned()
    asked = _planned(stop_at=[free.stops[-1].station])
    assert asked.arrival.delivery_mean.value <= 1.05 * free.arrival.delivery_mean.value


@pytest.mark.parametrize(
    ("wish", "said"),
    [
        ({"stop_at": ["siuh-north"]}, "start or the destination"),
        ({"stop_at": ["jacobi"], "planner": "pfs"}, "plans no stops"),
        ({"stop_at": ["jacobi"], "avoid": ["jacobi"]}, "a requested stop"),
        ({"avoid": ["white-plains"]}, "the destination"),
        ({"avoid": ["edison:jacobi"]}, "no such segment"),
        ({"avoid": ["nowhere"]}, "no such station"),
    ],
)
def test_wishes_that_cannot_be_met_are_refused(wish, said):
    with pytest.raises(InputError, match=said):
        _planned(**wish)


def test_the_command_line_takes_the_same_wishes(capsys):
    words = ["plan", "--from", "bellevue", "--to", "jacobi", "--payload", "0.8", "--depart", DEPART, "--drone", "m300"]
    assert main([*words, "--stop-at", "columbia", "--avoid", "yankee"]) == 0
    said = capsys.readouterr().out
    assert "columbia: " in said
    assert "Note: stops as requested: columbia; avoided as requested: yankee" in said


def test_the_briefing_and_the_kml_tell_the_plan_and_escape_what_people_typed(capsys, tmp_path):
    from xml.etree import ElementTree as ET

    kml, page = tmp_path / "way.kml", tmp_path / "way.html"
    words = [
        "plan",
        "--from",
        "bellevue",
        "--to",
        "40.9,-73.9",
        "--payload",
        "0.8",
        "--depart",
        DEPART,
        "--wind",
        "5@250",
        "--json",
    ]
    assert main([*words, "--kml", str(kml), "--briefing", str(page), "--contact", "<script>1</script> & Co"]) == 0
    plan = json.loads(capsys.readouterr().out)
    marks = ET.parse(kml).getroot().findall(".//{*}Placemark")
    lines = [one.find(".//{*}LineString/{*}coordinates") for one in marks]
    assert sum(line is not None for line in lines) == len(plan["legs"]) + len(plan["return"]["plan"]["legs"])
    lon, lat, height = lines[0].text.split()[0].split(",")
    start = plan["stations"][plan["from"]]
    assert (float(lat), float(lon), float(height)) == (start["lat"], start["lon"], plan["cruise_height_m"])
    text = page.read_text()
    assert "<script" not in text
    assert "&lt;script&gt;1&lt;/script&gt; &amp; Co" in text
    assert "{{" not in text
    for leg in plan["legs"]:
        assert f"{leg['distance_m'] / 1000.0:.1f}" in text
        assert all(name in text for name in leg["diverts"])
