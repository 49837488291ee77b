"""The weather and the pads of now: what ``plan``, ``compare``, ``wind`` and ``fly`` take, tell and refuse."""

import json
import os
import shutil
import socket
import threading
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import numpy as np
import pytest
from cli_requests import HOP, ONE_WIND

from skyway.cli.request_options import ConditionOptions, PadOptions
from skyway.link.supervisor.journal.entries import Landed
from skyway.link.supervisor.journal.file import SCHEMA
from skyway.link.supervisor.wind_book import WindBook
from skyway.missions.examples import NEW_YORK
from skyway.models.base.errors import InputError
from skyway.models.base.units import from_posix, iso
from skyway.models.composition.file import load
from skyway.models.queues.pad_service import PadAnswer, StationStatus, decode_request, encode
from skyway.now import HOW, LiveWinds
from skyway.scenarios import load_scenario

QUICK = ("--drone", "m200", "--planner", "pfs")
METARS = """KEWR 101751Z 27016G24KT 10SM CLR 31/20 A2990
KJFK 101751Z 23012KT 10SM CLR 29/21 A2991
KLGA 101751Z VRB05KT 10SM CLR 30/20 A2990
KLGA 101651Z 31020KT 10SM CLR 30/20 A2990
"""


@pytest.fixture
def metars(tmp_path):
    file = tmp_path / "metars.txt"
    file.write_text(METARS)
    return file


@pytest.fixture
def planned(skyway):
    def run(*arguments):
        answer = skyway("plan", *arguments, "--json")
        assert answer.code == 0, answer.err
        return json.loads(answer.out)

    return run


def winds_of(document):
    return [one["wind"] for one in document["legs"]]


def test_a_plan_is_conditioned_on_metars_and_says_so(planned, metars, tmp_path):
    found = planned(*HOP, *QUICK, "--observed", metars, "-o", tmp_path / "plan.json")
    assert [(one["kind"], one["place"], one["age_s"], one["source"]) for one in found["conditions"]] == [
        ("wind", site, 540.0, str(metars)) for site in ("EWR", "JFK", "LGA")
    ]
    assert found["conditions"][0]["speed_mps"] == pytest.approx(16 * 1852 / 3600)
    assert (found["conditions"][0]["from_deg"], found["conditions"][2]["from_deg"]) == (270.0, None)
    said = (
        "conditioned on the observed wind: EWR 8.2 m/s from 270°, 9 min before the departure; JFK 6.2 m/s from 230°, "
    )
    assert found["notes"][-1].startswith(said)
    assert load(tmp_path / "plan.json").conditions[1].place == "JFK"


def test_what_a_plan_is_told_moves_its_wind(planned):
    (leg,) = winds_of(
        planned(*HOP, *QUICK, *[word for site in ("EWR", "JFK", "LGA") for word in ("--observed", f"{site}=9@320")])
    )[:1]
    assert leg["from_deg"] == pytest.approx(320.0, abs=20.0)
    assert leg["speed_mps"] == pytest.approx(9.0 * 6.0**0.2, abs=2.0)  # carried from 10 m to 60 m
    without = planned(*HOP, *QUICK)
    assert "conditions" not in without
    assert HOW not in without["notes"]
    (alone,) = winds_of(without)[:1]
    assert leg["p90_mps"] - leg["p10_mps"] < 0.8 * (alone["p90_mps"] - alone["p10_mps"])


def test_compare_and_wind_take_it_too(skyway, metars):
    answer = skyway("compare", "--planners", "pfs,shortest", *HOP, "--drone", "m200", "--observed", metars)
    assert "Note: conditioned on the observed wind: EWR" in answer.out
    shown = [skyway("wind", "--depart", "2013-07-10T14:00-04:00", *more).out for more in ((), ("--observed", metars))]
    assert shown[0] != shown[1]
    assert "Note: conditioned on the observed wind: EWR" in shown[1]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            ("--observed", "KTEB=8@270"),
            "--observed: unknown station KTEB (got 'KTEB=8@270'); the scenario's wind sites are EWR, JFK, LGA",
        ),
        (("--observed", "EWR=8@270@2013-07-10T15:00-04:00"), "after the departure and ignored"),
        (
            ("--observed", "EWR=8@270@2013-07-09T15:00-04:00"),
            "none of 1 observed winds is usable: the wind observed at EWR is ignored: 23 h",
        ),
        (
            ("--observed", "EWR=8@270", "--observed", "EWR=8@090"),
            "EWR: two winds at 2013-07-10T18:00:00Z contradict each other",
        ),
        (("--observed", "EWR=8@270", "--wind", "8@270"), "--wind and --observed exclude each other"),
        (("--observed", "none.txt"), "none.txt: no such file"),
        (("--pads", "none.jsonl"), "none.jsonl: no such file"),
        (("--pads", "tcp:nowhere"), "--pads"),
        (("--pads", "x.jsonl", "--depart-window", "2h"), "--pads: cannot be combined with --depart-window"),
    ],
)
def test_what_cannot_count_is_one_clear_line(refused, options, said):
    assert said in refused("plan", *HOP, *QUICK, *options)


def journal_with(file, observations):
    """A journal as a flight leaves it on landing, with what it has measured."""
    standing = {
        "station": "bellevue", "visited": ["bellevue"], "belief": {}, "diverts": [], "charge_to": None, "asked_once": True, "gauge": 1.0,
        "lost_soc": 0.0, "observations": observations,
    }  # fmt: skip
    start = {
        "n": 1,
        "time": "2013-07-10T17:10:00Z",
        "state": "connecting",
        "event": "start",
        "data": {"schema": SCHEMA},
    }
    landed = {
        "n": 2,
        "time": "2013-07-10T17:40:00Z",
        "state": "landed",
        "event": Landed.event(),
        "data": standing,
    }
    file.write_text("".join(json.dumps(one) + "\n" for one in (start, landed)))


def test_what_a_drone_measured_is_taken_from_its_journal(tmp_path, refused):
    file, world, now = tmp_path / "flight.jsonl", load_scenario(None), datetime(2013, 7, 10, 18, tzinfo=UTC)
    measured = {"lat_deg": 40.8, "lon_deg": -73.9, "north_mps": 0.0, "east_mps": 9.0, "variance": 1.0, "height_m": 60.0}
    journal_with(file, [measured | {"time_s": now.timestamp() - age_s} for age_s in (1200.0, 1800.0, 30 * 3600.0)])
    seen = LiveWinds(world, [str(file)], now, asked=True, tell=lambda _: None)(now.timestamp())
    assert [(now.timestamp() - one.time_s, one.height_m, one.east_mps) for one in seen] == [
        (1200.0, 60.0, 9.0),
        (1800.0, 60.0, 9.0),
    ]
    journal_with(file, [])
    assert "flight.jsonl has no wind" in refused("plan", *HOP, *QUICK, "--observed", file)


def test_the_departures_of_a_window_each_know_what_was_observed_before_them(planned, metars):
    found = planned(*HOP, *QUICK, "--depart-window", "1h", "--observed", metars)
    best = datetime.fromisoformat(found["depart"])
    assert found["conditions"][0]["age_s"] == (best - datetime(2013, 7, 10, 17, 51, tzinfo=UTC)).total_seconds()


def test_an_observation_without_a_time_is_of_the_departure_asked_for_not_of_each_one_tried(planned):
    found = planned(*HOP, *QUICK, "--depart-window", "1h", "--observed", "EWR=12@270")
    assert datetime.fromisoformat(found["conditions"][0]["time"]) == datetime(2013, 7, 10, 18, 0, tzinfo=UTC)


def test_departures_from_the_deadline_on_are_not_tried(planned):
    when = "on-time 2013-07-10T14:40-04:00"
    found = planned(*HOP, *QUICK, "--depart-window", "2h", "--objective", when)
    assert datetime.fromisoformat(found["depart"]) < datetime(2013, 7, 10, 18, 40, tzinfo=UTC)


def test_a_wind_that_nobody_can_have_observed_yet_is_told():
    assert (
        "of a time still to come"
        in told_now(load_scenario(None), depart="2030-07-10T14:00-04:00", observed=["EWR=8@270"])[1]
    )
    assert (
        "still to come" not in told_now(load_scenario(None), depart="2013-07-10T14:00-04:00", observed=["EWR=8@270"])[1]
    )


# Pads


@pytest.mark.slow
def test_busy_pads_lengthen_the_wait_and_known_ends_shorten_it(planned, tmp_path):
    file, trip = (
        tmp_path / "pads.jsonl",
        ("--from", "siuh-north", "--to", "white-plains", "--payload", "0.8", *HOP[-2:], *ONE_WIND),
    )
    depart_s = datetime.fromisoformat("2013-07-10T14:00-04:00").timestamp()
    stations = [line.split(",")[0] for line in (NEW_YORK / "stations.csv").read_text().splitlines()[1:]]

    def mean_with(**told):
        file.write_text(
            "\n".join(
                json.dumps({"station": one, "busy": 5, "waiting": 4, "posix_s": depart_s - 60.0} | told)
                for one in stations
            )
        )
        return planned(*trip, "--pads", file)

    usual = planned(*trip)
    full, leaving = mean_with(), mean_with(remaining_s=[1.0] * 5, waiting=0)
    means = [one["arrival"]["delivery_mean_s"]["value"] for one in (leaving, usual, full)]
    assert means == sorted(means)
    assert means[2] - means[1] > 600.0
    assert full["conditions"][0] | {"place": ""} == {
        "kind": "pads", "place": "", "time": iso(from_posix(depart_s - 60.0)), "age_s": 60.0, "source": str(file), "speed_mps": None,
        "from_deg": None, "busy": 9,
    }  # fmt: skip
    assert full["notes"][-1].startswith("conditioned on the pads seen up to 1 min before the departure: 9 drones at ")


def test_pads_are_asked_of_a_service_once(planned):
    depart_s = datetime.fromisoformat("2013-07-10T14:00-04:00").timestamp()
    asked = []
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve():
            peer, _ = listener.accept()
            with peer, peer.makefile("rb") as lines:
                for line in lines:
                    asked.append(decode_request(line).station)
                    one = StationStatus(
                        station=asked[-1],
                        posix_s=depart_s,
                        pads=5,
                        busy=1,
                        remaining_s=(),
                        waiting=0,
                        holding_spots=2,
                        holding_free=2,
                    )
                    peer.sendall(encode(PadAnswer(ok=True, station=one)))

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        found = planned(*HOP, *QUICK, "--pads", f"tcp:127.0.0.1:{listener.getsockname()[1]}")
        thread.join(5.0)
    assert sorted(asked) == sorted(one["place"] for one in found["conditions"])
    assert len(set(asked)) == len(asked) == 46


def test_a_service_that_does_not_speak_of_pads_is_named(refused):
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve():
            peer, _ = listener.accept()
            with peer:
                peer.recv(1000)
                peer.sendall(b"220 mail.example.org\n")

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        address = f"tcp:127.0.0.1:{listener.getsockname()[1]}"
        message = refused("plan", *HOP, *QUICK, "--pads", address, code=3)
        thread.join(5.0)
    assert f"{address}: not an answer of the pad service" in message


def test_a_pad_that_the_service_has_not_is_out_of_order(tmp_path):
    file, now = tmp_path / "pads.jsonl", datetime(2013, 7, 10, 18, tzinfo=UTC)
    file.write_text(
        '{"station": "bellevue", "busy": 2, "pads": 3, "remaining_s": [60]}\n{"station": "jacobi", "busy": 0, "pads": 9}'
    )
    found = PadOptions(pads=str(file)).known(load_scenario(None), now, for_now=False)
    assert found.busy == {"bellevue": 4, "jacobi": 0}  # of five pads two are gone
    day_s = 24 * 3600.0
    assert found.free_s == {"bellevue": (now.timestamp() + 60.0, now.timestamp() + day_s, now.timestamp() + day_s)}
    assert found.notes == ("fewer pads than the scenario has, for 24 h at least: bellevue 3 of 5",)
    assert [one.busy for one in found.conditions] == [2, 0]


def test_pads_seen_long_ago_do_not_count(refused, tmp_path):
    file = tmp_path / "pads.jsonl"
    file.write_text('{"station": "bellevue", "busy": 5, "posix_s": 1373400000}')
    assert "seen 22 h before the departure, the limit is 30 min before it" in refused(
        "plan", *HOP, *QUICK, "--pads", file
    )


# Unasked


@pytest.fixture
def region(tmp_path):
    """New York with files of now: those of a cron job, which may be missing."""
    folder = tmp_path / "region"
    shutil.copytree(NEW_YORK, folder)
    toml = folder / "scenario.toml"
    toml.write_text(toml.read_text() + '\n[observed]\nwind = ["metars.txt"]\npads = "pads.jsonl"\n')
    return folder


FOR_NOW = ("--from", "bellevue", "--to", "jacobi", "--payload", "0.8", *QUICK)


def test_a_plan_for_now_uses_the_files_of_its_scenario_unasked(planned, region):
    seen = datetime.now(UTC) - timedelta(minutes=20)
    (region / "metars.txt").write_text(f"KEWR {seen:%d%H%M}Z 27016KT\n")
    (region / "pads.jsonl").write_text('{"station": "bellevue", "busy": 3}')
    found = planned(region, *FOR_NOW)
    assert [(one["kind"], one["place"]) for one in found["conditions"]] == [("wind", "EWR"), ("pads", "bellevue")]
    assert HOW not in found["notes"]


def told_now(world, **options):
    """Places that the wind for now is conditioned on, and notes."""
    conditions = ConditionOptions(**options)
    known, _ = conditions.winds(world, conditions.instant, None)
    return [one.place for one in known.conditions], " ".join(known.notes)


def test_what_is_handed_over_comes_before_the_files_of_the_scenario(tmp_path):
    file = tmp_path / "metars.txt"
    file.write_text(f"KEWR {datetime.now(UTC) - timedelta(minutes=20):%d%H%M}Z 27016KT\n")
    world = replace(load_scenario(None), observed_wind=(str(file),))
    assert told_now(world) == (["EWR"], "")
    assert told_now(world, observed=["JFK=4@090"]) == (["JFK"], "")
    assert told_now(world, depart="2013-07-10T14:00-04:00") == ([], "")  # is not now
    assert told_now(world, wind="8@270") == ([], "")
    file.write_text(f"KEWR {datetime.now(UTC) - timedelta(hours=9):%d%H%M}Z 27016KT\n")
    places, notes = told_now(world)
    assert places == []
    assert "the wind observed at EWR is ignored: 9 h before the departure" in notes


def test_without_any_a_plan_for_now_says_that_it_knows_the_record_alone():
    assert told_now(load_scenario(None)) == ([], HOW)


def test_files_and_services_of_now_that_are_not_there_are_notes(tmp_path):
    world = replace(load_scenario(None), observed_wind=("none.txt",), observed_pads=str(tmp_path / "none.jsonl"))
    assert told_now(world) == ([], "no current wind: none.txt does not exist")
    now = datetime.now(UTC)
    pads = PadOptions().known(world, now, for_now=True)
    assert (pads.busy, pads.notes) == ({}, (f"no current pads: {tmp_path / 'none.jsonl'} does not exist",))
    assert PadOptions().known(world, now, for_now=False) is None
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    pads = PadOptions().known(replace(world, observed_pads=f"tcp:127.0.0.1:{port}"), now, for_now=True)
    assert pads.notes[0].startswith(f"no current pads: the pad service at tcp:127.0.0.1:{port} failed")


def test_a_file_of_pads_that_no_job_writes_any_more_does_not_count(tmp_path):
    file = tmp_path / "pads.jsonl"
    file.write_text('{"station": "bellevue", "busy": 3}')
    world, now = replace(load_scenario(None), observed_pads=str(file)), datetime.now(UTC)
    assert PadOptions().known(world, now, for_now=True).busy == {"bellevue": 3}
    os.utime(file, (now.timestamp() - 7200.0, now.timestamp() - 7200.0))
    stale = PadOptions().known(world, now, for_now=True)
    assert stale.busy == {}
    assert "pads of 1 station are ignored: seen 2 h before the departure" in stale.notes[0]


def test_shortly_before_it_is_now_a_plan_says_that_it_does_not_know_the_files_of_now(tmp_path):
    world = replace(load_scenario(None), observed_wind=("none.txt",))
    soon = (datetime.now(UTC) + timedelta(minutes=20)).isoformat()
    assert "the scenario's own observations are not used: the departure is" in told_now(world, depart=soon)[1]
    later = (datetime.now(UTC) + timedelta(days=2)).isoformat()
    assert told_now(world, depart=later) == ([], "")


def test_a_broken_file_of_now_is_an_error(tmp_path):
    (tmp_path / "metars.txt").write_text("<html>503</html>")
    with pytest.raises(InputError, match="is not a METAR"):
        told_now(replace(load_scenario(None), observed_wind=(str(tmp_path / "metars.txt"),)))


def test_a_flight_knows_what_was_observed(metars):
    world, now = load_scenario(None), datetime(2013, 7, 10, 18, tzinfo=UTC)
    winds = LiveWinds(world, [str(metars)], now, asked=True, tell=lambda _: None)
    base = world.forecast(now - timedelta(hours=1), 12)
    alone, told = WindBook(base, world.rules), WindBook(base, world.rules, at_stations=winds)
    place = SimpleNamespace(lat=40.6825, lon=-74.1694)  # Newark, 8.2 m/s from the west at 10 m
    before, after = (one.forecast_at(now.timestamp(), place.lat, place.lon, updated=True) for one in (alone, told))
    assert after.p90_mps - after.p10_mps < before.p90_mps - before.p10_mps
    assert after.from_deg == pytest.approx(270.0, abs=15.0)
    assert (alone.origin, told.origin) == ("forecast", "forecast updated with the observed winds")


def test_a_flight_reads_a_file_of_winds_again_when_it_has_changed(tmp_path):
    world, now = load_scenario(None), datetime(2013, 7, 10, 18, tzinfo=UTC)
    file, told = tmp_path / "metars.txt", []
    file.write_text("KEWR 101751Z 27016KT 10SM 30/20 A2992\n")
    winds = LiveWinds(world, [str(file)], now, asked=True, tell=told.append)
    later_s = now.timestamp() + 3600.0

    def speeds(time_s):
        return [round(float(np.hypot(one.north_mps, one.east_mps)), 1) for one in winds(time_s)]

    assert speeds(now.timestamp()) == [8.2]
    file.write_text("KEWR 101751Z 27016KT 10SM 30/20 A2992\nKEWR 101851Z 27026KT 10SM 30/20 A2990\n")
    assert speeds(later_s) == [13.4]
    file.write_text("<html>503 Service Unavailable</html>")
    assert speeds(later_s + 60.0) == [13.4]  # what was read before counts on
    assert speeds(later_s + 90.0) == [13.4]
    assert len(told) == 1
    assert "is not a METAR" in told[0]
    assert told[0].endswith("still using the winds read before")
    file.unlink()
    assert speeds(later_s + 120.0) == [13.4]
    assert speeds(later_s + 12 * 3600.0) == []  # too old by then
