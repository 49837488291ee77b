"""``skyway plan`` and ``skyway compare`` on the built-in scenario: what they print, write and promise."""

import json
import re
import shutil
import subprocess
import sys
from datetime import datetime
from html import escape
from itertools import pairwise

import pytest
from cli_requests import HOP, ONE_WIND, TRIP
from one_leg import wind_triangle

from skyway.missions.examples import NEW_YORK
from skyway.models.base.formatting import duration, from_to, percent
from skyway.models.composition.file import load

TOP = {
    "schema": str, "id": str, "scenario": dict, "planner": str, "drone": str, "drone_parameters": dict,
    "payload_kg": float, "airspeed_mps": float, "max_ground_speed_mps": float, "cruise_height_m": float,
    "climb_rate_mps": float, "descent_rate_mps": float, "reserve_soc": float, "seed": int, "depart": str, "from": str,
    "to": str, "stations": dict, "legs": list, "stops": list, "delivery_time_s": float, "flight_time_s": float,
    "wait_time_s": float, "recharge_time_s": float, "distance_m": float, "energy_wh": float, "min_soc": float,
    "arrival": dict, "on_time_probability": type(None), "on_time": type(None), "success_probability": float,
    "success": (dict, type(None)), "planning_time_s": float, "notes": list, "parameters": dict, "return": dict,
}  # fmt: skip
LEG = {
    "id": str, "from": str, "to": str, "via": list, "distance_m": float, "bearing_deg": float,
    "ground_speed_mps": float, "depart": str, "arrive": str, "flight_time_s": float, "energy_wh": float,
    "soc_depart": float, "soc_arrive": float, "p_reserve": float, "p_hold": float, "p_hold_room": float,
    "wind": dict, "course_wind": dict, "tailwind_mps": float, "crosswind_mps": float, "segments": list, "diverts": list,
}  # fmt: skip
STOP = {
    "station": str, "arrive": str, "wait_s": float, "hold_s": float, "hold_room_s": float, "p_pad_free": float, "recharge_s": float,
    "soc_from": float, "soc_to": float, "leave": str,
}  # fmt: skip
BOUND = {"bound_s": float, "plan_s": float, "worlds": int, "gap": float}
PLACE = {"lat": float, "lon": float, "elevation_m": float, "name": str, "pads": int}


def fits(values, schema) -> None:
    assert set(values) == set(schema)
    for key, kind in schema.items():
        assert isinstance(values[key], (int, float) if kind is float else kind), (key, values[key])


def seconds(later: str, earlier: str) -> float:
    return (datetime.fromisoformat(later) - datetime.fromisoformat(earlier)).total_seconds()


@pytest.fixture(scope="module")
def answers():
    """Texts of plans by their arguments: what several tests ask is planned once."""
    return {}


@pytest.fixture
def plan_json(skyway, answers):
    def run(*arguments, again=False):
        if again or arguments not in answers:
            answer = skyway("plan", *arguments, "--json")
            assert answer.code == 0, answer.err
            answers[arguments] = answer.out
        return json.loads(answers[arguments])

    return run


REQUESTS = {
    "the fleet, forecast": TRIP,
    "one drone, forecast": (*TRIP, "--drone", "m200"),
    "one wind": (*TRIP, *ONE_WIND, "--recharge", "enough"),
    "full recharge": (*TRIP, *ONE_WIND, "--recharge", "full"),
    "pfs": (*TRIP, "--drone", "m200", "--planner", "pfs"),
    "shortest": (*TRIP, "--planner", "shortest"),
    "the truth": (*HOP, "--drone", "m200", "--planner", "ies"),
    "charging first": (*HOP, "--drone", "m200", "--soc", "25", "--reserve", "15"),
    "a delivery target": ("--from", "bellevue", "--to", "40.75,-73.93", *HOP[4:]),
}


@pytest.mark.parametrize("request_", REQUESTS.values(), ids=REQUESTS.keys())
def test_json_of_a_plan_has_every_field_and_adds_up(plan_json, request_):
    plan = plan_json(*request_)
    bound = plan.pop("bound", None)
    assert (bound is not None) == (plan["planner"] == "robust")
    if bound is not None:
        fits(bound, BOUND)
        assert bound["gap"] == pytest.approx(bound["plan_s"] / bound["bound_s"] - 1.0)
    between = plan.pop("between_sites", None)
    assert between is None or plan["planner"] == "robust"
    if between is not None:
        assert 0.0 <= between["p_below"] <= between["p_turned"] <= 1.0
        assert between["delivery_mean"]["value"] >= plan["arrival"]["delivery_mean_s"]["value"]
        assert between["station"]
    fits(plan, TOP)
    assert plan["schema"] == "skyway.composition/1"
    assert set(plan["scenario"]) == {"path", "sha256"}
    assert set(plan["arrival"]) == {
        "mean", "p50", "p95", "delivery_mean_s", "delivery_p50_s", "delivery_p95_s", "runs", "p_arrive",
    }  # fmt: skip
    for leg in plan["legs"]:
        fits(leg, LEG)
        fits(leg["wind"], {"speed_mps": float, "from_deg": (float, type(None)), "p10_mps": float, "p90_mps": float})
    for stop in plan["stops"]:
        fits(stop, STOP)
    for key, place in plan["stations"].items():
        fits(place, PLACE if key != "target" else PLACE | {"elevation_m": type(None)})
    legs, stops = plan["legs"], plan["stops"]
    assert plan["flight_time_s"] == pytest.approx(sum(leg["flight_time_s"] for leg in legs))
    assert plan["wait_time_s"] == pytest.approx(sum(stop["wait_s"] + stop["hold_s"] for stop in stops))
    assert plan["recharge_time_s"] == pytest.approx(sum(stop["recharge_s"] for stop in stops))
    total = plan["flight_time_s"] + plan["wait_time_s"] + plan["recharge_time_s"]
    assert plan["delivery_time_s"] == pytest.approx(total)
    assert plan["delivery_time_s"] == pytest.approx(seconds(legs[-1]["arrive"], plan["depart"]), abs=1.0)
    assert plan["distance_m"] == pytest.approx(sum(leg["distance_m"] for leg in legs))
    assert plan["energy_wh"] == pytest.approx(sum(leg["energy_wh"] for leg in legs))
    assert plan["min_soc"] == min(leg["soc_arrive"] for leg in legs) >= plan["reserve_soc"] - 1e-9


@pytest.mark.parametrize("request_", REQUESTS.values(), ids=REQUESTS.keys())
def test_legs_and_stops_of_a_plan_follow_each_other_without_a_gap(plan_json, request_):
    plan = plan_json(*request_)
    legs, stops = plan["legs"], {stop["station"]: stop for stop in plan["stops"]}
    assert (legs[0]["from"], legs[-1]["to"]) == (plan["from"], plan["to"])
    first = stops.get(plan["from"])
    assert (first["arrive"] if first else legs[0]["depart"]) == plan["depart"]
    for before, after in pairwise(legs):
        assert before["to"] == after["from"]
        stop = stops[after["from"]]
        assert abs(seconds(stop["arrive"], before["arrive"])) <= 0.002
        assert stop["soc_from"] == pytest.approx(before["soc_arrive"])
    for leg in legs:
        assert seconds(leg["arrive"], leg["depart"]) == pytest.approx(leg["flight_time_s"], abs=0.002)
        spent = leg["energy_wh"] / plan["drone_parameters"]["battery_wh"]
        assert leg["soc_arrive"] == pytest.approx(leg["soc_depart"] - spent, abs=1e-9)
        if leg["from"] in stops:
            stop = stops[leg["from"]]
            stay = stop["wait_s"] + stop["recharge_s"] + stop["hold_s"]
            assert seconds(leg["depart"], stop["arrive"]) == pytest.approx(stay, abs=0.002)
            assert leg["soc_depart"] == pytest.approx(stop["soc_to"])
        assert {leg["from"], leg["to"], *leg["via"], *leg["diverts"]} <= set(plan["stations"])


def test_ground_speed_of_each_leg_is_the_wind_triangle_capped_at_what_autopilots_accept(plan_json):
    capped = 0
    for request, wind in ((REQUESTS["full recharge"], "8@270"), ((*TRIP, "--drone", "m200", "--wind", "8@30"), "8@30")):
        plan = plan_json(*request)
        direction = float(wind.split("@")[1])
        for leg in plan["legs"]:
            if leg["via"]:
                continue
            grounds = [plan["stations"][leg[end]]["elevation_m"] for end in ("from", "to")]
            half_way_m = max(grounds) + plan["cruise_height_m"] - sum(grounds) / 2.0
            speed = float(wind.split("@")[0]) * (half_way_m / plan["cruise_height_m"]) ** 0.2
            assert leg["wind"]["speed_mps"] == pytest.approx(speed)
            assert leg["wind"]["from_deg"] == pytest.approx(direction)
            triangle = wind_triangle(
                plan["airspeed_mps"],
                speed,
                direction,
                leg["bearing_deg"],
                max_ground_speed_mps=plan["max_ground_speed_mps"],
            )
            assert leg["ground_speed_mps"] == pytest.approx(triangle.ground_speed_mps)
            assert leg["tailwind_mps"] == pytest.approx(triangle.tailwind_mps)
            capped += leg["ground_speed_mps"] == plan["max_ground_speed_mps"]
            climb = plan["cruise_height_m"] / plan["climb_rate_mps"]
            climb += plan["cruise_height_m"] / plan["descent_rate_mps"]
            cruise = leg["distance_m"] / leg["ground_speed_mps"]
            assert leg["flight_time_s"] == pytest.approx(climb + cruise, abs=0.002)
    assert capped


def test_the_table_shows_what_the_json_says(skyway, plan_json):
    plan = plan_json(*REQUESTS["one wind"])
    answer = skyway("plan", *REQUESTS["one wind"])
    assert answer.code == 0
    for leg in plan["legs"]:
        assert f"{leg['from']} > " in answer.out
        assert f"{leg['distance_m'] / 1000:.1f}" in answer.out
    for stop in plan["stops"]:
        assert f"{stop['station']}: " in answer.out
    assert re.match(
        r"Delivery in [0-9a-z ]+ on average: half of the deliveries by [0-9:]+, 95 % by [0-9:]+ EDT\b",
        " ".join(answer.out.split()),
    )
    assert "A typical schedule" in answer.out
    mean = plan["arrival"]["delivery_mean_s"]
    assert mean["low"] < mean["value"] < mean["high"]
    told = re.search(r"on average +(?:(\d+) h)?(?: ?(\d+) min)?(?: ?(\d+) s)?", answer.out)
    hours, minutes, rest = (int(part or 0) for part in told.groups())
    assert mean["low"] <= 3600 * hours + 60 * minutes + rest <= mean["high"]
    assert not any(line.endswith(" ") for line in answer.out.splitlines())


def test_warnings_about_the_input_reach_a_person_who_plans_and_leave_the_json_alone(skyway, tmp_path):
    shutil.copytree(NEW_YORK, tmp_path / "mine")
    answer = skyway("plan", "mine", *HOP, "--planner", "shortest", "--json")
    assert answer.err == "skyway: 2 warnings about the input, see: skyway scenario check mine\n"
    json.loads(answer.out)
    assert skyway("plan", *HOP, "--planner", "shortest", "--json").err == ""  # nobody can mend the built-in scenario
    told = skyway("scenario", "check")
    assert told.code == 0
    assert "1048.36058 mph" in told.err


def test_a_station_is_found_by_id_by_part_of_its_name_and_by_position(plan_json):
    rest = (*HOP[2:], "--drone", "m200", "--planner", "shortest")
    assert plan_json("--from", "bellevue", *rest)["from"] == "bellevue"
    assert plan_json("--from", "Elmhurst", *rest)["from"] == "elmhurst"
    assert plan_json("--from", "hospitals/ELM", *rest)["from"] == "elmhurst"
    plan = plan_json(*REQUESTS["a delivery target"])
    assert (plan["stations"]["target"]["lat"], plan["stations"]["target"]["lon"]) == (40.75, -73.93)
    assert plan["stations"]["target"]["pads"] == 0
    both = plan_json("--from", "40.73,-73.99", "--to", "40.75,-73.93", *rest[2:])
    assert both["from"] != both["to"]


def test_what_becomes_of_the_drone_is_in_every_plan(plan_json, skyway):
    street = ("--from", "bellevue", "--to", "40.75,-73.93", *HOP[4:], "--drone", "m200", "--wind", "5@250")
    back = plan_json(*street, "--return", "home", "--dwell", "2min", "--if-undelivered", "back")["return"]
    assert (back["asked"], back["to"], back["dwell_s"], back["undelivered_to"]) == (
        "home",
        "bellevue",
        120.0,
        "bellevue",
    )
    assert (back["plan"]["payload_kg"], back["undelivered"]["payload_kg"]) == (0.0, 0.8)
    station = plan_json(*HOP, "--drone", "m200", "--wind", "5@250")
    assert station["return"] == {"asked": "nearest-pad", "to": station["to"], "dwell_s": 0.0, "plan": None}
    for option, value in (("--return", "none"), ("--return", "mars"), ("--dwell", "5"), ("--dwell", "50h")):
        refused = skyway("plan", *street, option, value)
        assert refused.code == 2, option
        assert refused.err.startswith(f"skyway: {option}:"), refused.err


def test_every_option_of_plan_shows_in_the_plan(plan_json):
    plan = plan_json(*HOP, "--drone", "m200", "--airspeed", "15", "--reserve", "30", "--soc", "90", "--seed", "7")
    assert plan["airspeed_mps"] == 15
    assert plan["reserve_soc"] == 0.3
    assert plan["seed"] == 7
    assert plan["legs"][0]["soc_depart"] <= 1.0
    assert plan["drone"] == "m200"
    assert plan_json(*HOP, "--planner", "shortest")["planner"] == "shortest"
    truth = plan_json(*HOP, "--planner", "ies", "--actual-wind", "2013-07-09", "--drone", "m200", "--time-limit", "30")
    assert truth["planner"] == "ies"
    full = plan_json(*REQUESTS["full recharge"])
    assert {stop["soc_to"] for stop in full["stops"] if stop["recharge_s"]} == {1.0}
    enough = plan_json(*REQUESTS["one wind"])
    assert enough["recharge_time_s"] < full["recharge_time_s"]


def test_without_a_departure_the_delivery_starts_now(plan_json):
    plan = plan_json("--from", "bellevue", "--to", "jacobi", "--payload", "0.5", "--wind", "3@0")
    age = datetime.now().astimezone() - datetime.fromisoformat(plan["depart"])
    assert 0 <= age.total_seconds() < 120


def test_a_plan_from_a_forecast_file_and_with_a_truth_file(skyway, tmp_path):
    rows = ["time,site,member,speed_mps,from_deg"]
    for hour in range(14, 24):
        for site in ("EWR", "JFK", "LGA"):
            rows += [f"2013-07-10T{hour}:00Z,{site},a,4,200", f"2013-07-10T{hour}:00Z,{site},b,6,250"]
    (tmp_path / "forecast.csv").write_text("\n".join(rows))
    (tmp_path / "truth.csv").write_text("\n".join(row for row in rows if ",b," not in row))
    forecast = ("--forecast", "forecast.csv")
    plan = skyway("plan", *HOP, *forecast, "--json")
    assert plan.code == 0, plan.err
    winds = {round(leg["wind"]["from_deg"]) for leg in json.loads(plan.out)["legs"]}
    assert winds == {225}  # the middle of the two that may blow
    told = skyway(
        "plan", *HOP, *forecast, "--actual-wind", "truth.csv", "--planner", "ies", "--drone", "m200", "--json"
    )
    assert told.code == 0, told.err
    assert {round(leg["wind"]["from_deg"]) for leg in json.loads(told.out)["legs"]} == {200}


def test_files_are_written_once_and_overwritten_only_by_force(skyway, tmp_path):
    outputs = ("--drone", "m200", "-o", "plan.json", "--geojson", "route.geojson", "--plot", "plan.svg")
    assert skyway("plan", *HOP, *outputs).code == 0
    composition = load(tmp_path / "plan.json")
    assert composition.origin == "bellevue"
    route = json.loads((tmp_path / "route.geojson").read_text())
    kinds = [feature["geometry"]["type"] for feature in route["features"]]
    assert kinds.count("LineString") == len(composition.services)
    assert kinds.count("Point") == len(set(composition.route))
    picture = (tmp_path / "plan.svg").read_bytes()
    assert b"<svg" in picture
    again = skyway("plan", *HOP, *outputs)
    assert again.code == 2
    assert again.err.count("exists already") == 3
    assert (tmp_path / "plan.svg").read_bytes() == picture
    assert skyway("plan", *HOP, *outputs, "--force").code == 0
    assert (tmp_path / "plan.svg").read_bytes() == picture  # the same plan gives the same bytes


def test_the_file_of_a_plan_is_what_json_prints(skyway, tmp_path):
    asked = (*HOP, "--drone", "m200", "--as-flown", "20", "--alternatives", "2", "--json", "-o", "plan.json")
    answer = skyway("plan", *asked)
    assert answer.code == 0, answer.err
    told = json.loads(answer.out)
    assert {"bound", "as_flown", "alternatives"} <= set(told)
    assert json.loads((tmp_path / "plan.json").read_text()) == told
    assert load(tmp_path / "plan.json").destination == "jacobi"


def test_a_station_that_is_landed_at_twice_has_both_stops_in_every_file_and_picture(skyway, tmp_path):
    wanted = ("yankee-stadium", "columbia", "yankee-stadium", "columbia")
    route = [word for station in wanted for word in ("--stop-at", station)]
    outputs = ("-o", "plan.json", "--geojson", "route.geojson", "--kml", "route.kml", "--plot", "plan.svg")
    answer = skyway("plan", *HOP, *ONE_WIND, "--payload", "1.4", *route, *outputs)
    assert answer.code == 0, answer.err
    stops = [stop for stop in load(tmp_path / "plan.json").stops if stop.station == "columbia"]
    assert [stop.recharge_s > 0.0 for stop in stops] == [True, True]
    features = json.loads((tmp_path / "route.geojson").read_text())["features"]
    points = [one["properties"] for one in features if one["properties"].get("id") == "columbia"]
    assert [(one["soc_from"], one["soc_to"]) for one in points] == [(stop.soc_from, stop.soc_to) for stop in stops]
    charged = [f"charges {duration(stop.recharge_s)} to {percent(stop.soc_to)}" for stop in stops]
    kml = (tmp_path / "route.kml").read_text()
    assert kml.index(charged[0]) < kml.index(charged[1])
    picture = (tmp_path / "plan.svg").read_text()
    assert all(escape(f"{from_to(stop.soc_from, stop.soc_to)} %") in picture for stop in stops)


def test_the_same_request_gives_the_same_plan(plan_json):
    one, two = plan_json(*TRIP), plan_json(*TRIP, again=True)
    for plan in (one, two):
        del plan["planning_time_s"]
    assert one == two


def test_planners_are_compared_on_one_request(skyway):
    answer = skyway("compare", *HOP, "--drone", "m200", "--planners", "pfs,shortest,ies", "--json")
    assert answer.code == 0
    found = json.loads(answer.out)
    assert found["schema"] == "skyway.compare/1"
    assert [plan["planner"] for plan in found["plans"]] == ["pfs", "shortest", "ies"]
    for plan in found["plans"]:
        assert set(plan) == {"planner", "status", "error", "composition"}
        assert (plan["status"], plan["error"]) == ("ok", None)
        fits(plan["composition"], TOP)
        assert plan["composition"]["planner"] == plan["planner"]
    table = skyway("compare", *HOP, "--drone", "m200", "--planners", "pfs,shortest,ies")
    assert table.code == 0
    assert "ies has perfect information" in table.out
    assert not any(line.endswith(" ") for line in table.out.splitlines())


def test_given_one_wind_no_planner_beats_the_exhaustive_search(skyway):
    answer = skyway("compare", *HOP, *ONE_WIND, "--json")
    times = {plan["planner"]: plan["composition"]["delivery_time_s"] for plan in json.loads(answer.out)["plans"]}
    assert set(times) == {"robust", "pfs", "pfs-charge-aware", "shortest", "ies"}
    assert times["ies"] <= min(times.values()) + 1.0


def test_a_comparison_says_what_its_columns_are_of(skyway):
    request = (*HOP, "--drone", "m200")
    drawn = " ".join(skyway("compare", *request, "--planners", "pfs,exact").out.split())  # of terminals of any width
    plans = json.loads(skyway("compare", *request, "--planners", "pfs,exact", "--json").out)["plans"]
    runs = plans[0]["composition"]["arrival"]["runs"]
    assert (
        f"{runs:,} simulated deliveries in the wind of 30 days of the record, the same for all planners. ±: 95 % confidence interval"
        in drawn
    )
    assert '"flight" to "km": typical schedule' in drawn
    told = skyway("compare", *request, "--planners", "exact").out
    assert "simulated deliveries" not in told


def test_deliveries_that_do_not_arrive_are_told_wherever_figures_leave_them_out(skyway, plan_json):
    least = ("--from", "bellevue", *TRIP[2:], "--drone", "m200", "--objective", "energy")
    plan = plan_json(*least)
    never = 1.0 - plan["arrival"]["p_arrive"]
    assert never > 0.001, "the plan of this request waits for days without strong wind"
    table = skyway("compare", *least, "--planners", "robust,pfs").out
    told = f"robust: in {100.0 * never:.1f} % of the deliveries the drone stays at a stop until the end of the forecast"
    assert told in " ".join(table.split())
    words = " ".join(skyway("plan", *least).out.split())
    energy = f"{plan['energy']['mean_wh']['value']:.0f} Wh"
    assert f"Energy flown: {energy} on average" in words
    assert f"({energy} on average), lowest charge" in words, "of the same deliveries"


def test_a_comparison_without_any_answer_says_why_for_each_and_ends_with_1(skyway):
    heavy = [*HOP[:4], "--payload", "50", *HOP[6:]]
    answer = skyway("compare", *heavy, "--planners", "pfs,shortest", "--json")
    assert answer.code == 1
    plans = json.loads(answer.out)["plans"]
    assert [plan["status"] for plan in plans] == ["infeasible", "infeasible"]
    assert all("no drone lifts 50 kg" in plan["error"] for plan in plans)
    assert skyway("compare", *heavy, "--planners", "pfs,shortest").code == 1


def test_the_installed_command_and_the_module_answer_alike():
    command = [sys.executable, "-m", "skyway", "plan", *HOP, *ONE_WIND, "--json"]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout)["from"] == "bellevue"
    missing = subprocess.run([sys.executable, "-m", "skyway", "plan"], capture_output=True, text=True, check=False)
    assert missing.returncode == 2
    assert missing.stderr.startswith("skyway: Missing option '--from'. (see: ")


def test_output_cut_short_by_its_reader_is_no_traceback():
    command = f"{sys.executable} -m skyway network --json | head -c 10"
    found = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert "Traceback" not in found.stderr


def test_a_robust_plan_says_what_it_would_do_otherwise_and_why(skyway):
    answer = skyway("plan", *HOP, "--drone", "m200", "--alternatives", "2", "--explain")
    assert answer.code == 0
    out = answer.out
    assert "the charge depends on the wind at that time" in out
    assert "simulated deliveries" in out
    assert "Alternatives" in out or "No alternative" in out
    assert "without this stop" in out
    assert "Lower bound with perfect forecast" in out
    assert "reserve on landing" in out


def test_a_delivery_that_a_full_battery_does_not_end_is_not_called_blocked_by_the_wind(skyway):
    """In still air some drones take so much that the last leg needs more than a full battery: that was told as wind."""
    words = "plan --from bellevue --to white-plains --payload 0.8 --depart 2013-07-10T14:00-04:00 --wind 0@270 --objective energy --drone m200"
    told = " ".join(skyway(*words.split()).out.split())
    assert "the leg takes more than a full battery. The times above are of the others" in told


def test_a_deadline_is_told_as_a_probability(plan_json):
    late = plan_json(*HOP, "--drone", "m200", "--objective", "on-time 2013-07-11T02:00-04:00")
    soon = plan_json(*HOP, "--drone", "m200", "--objective", "on-time 2013-07-10T14:05-04:00")
    assert late["on_time_probability"] > 0.9
    assert soon["on_time_probability"] == 0.0


def test_a_window_lists_the_departures_that_were_tried(plan_json):
    document = plan_json(*HOP, "--drone", "m200", "--depart-window", "1h", "--explain")
    assert len(document["departures"]) == 3
    assert document["depart"] in [one["depart"] for one in document["departures"]]
    assert document["bound"]["gap"] >= -0.05


def test_a_comparison_says_in_plain_words_what_robust_buys(skyway):
    answer = skyway("compare", *TRIP, "--drone", "m200", "--planners", "robust,pfs")
    assert answer.code == 0
    out = " ".join(answer.out.split())
    assert "pfs against robust:" in out
    assert "on average" in out
    assert "of the deliveries land below the reserve, with robust" in out
    assert " why: " in out


def test_a_start_given_as_a_place_is_not_called_a_target(plan_json):
    plan = plan_json("--from", "40.75,-73.93", "--to", "jacobi", *HOP[4:], *ONE_WIND)
    assert (plan["from"], plan["stations"]["start"]["name"]) == ("start", "start 40.75000,-73.93000")


def test_a_planner_that_is_not_told_the_actual_wind_says_so(plan_json):
    said = "pfs is not told the actual wind, only planners with perfect information are (ies, exact)"
    assert said in plan_json(*HOP, "--planner", "pfs", "--actual-wind", "2013-07-12")["notes"]
    assert said not in plan_json(*HOP, "--planner", "pfs")["notes"]
