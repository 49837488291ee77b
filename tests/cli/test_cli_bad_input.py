"""What a person may type wrongly: one clear line, the right exit code, nothing written."""

import os

import pytest
from cli_requests import HOP, TRIP

DEPART = ("--depart", "2013-07-10T14:00-04:00")
FORECAST_HEADER = "time,site,member,speed_mps,from_deg"


def with_(option: str, value: str) -> list[str]:
    """A request with one option changed or added."""
    words = list(HOP)
    if option in words:
        words[words.index(option) + 1] = value
        return words
    return [*words, option, value]


WRONG = {
    "misspelt station": ("--from", "bellvue", "--from: no such station (got 'bellvue'); did you mean bellevue"),
    "ambiguous name": (
        "--to",
        "siuh",
        "--to: fits several stations (got 'siuh'); choose one of siuh-north, siuh-south",
    ),
    "empty station": ("--from", "", "--from: no such station"),
    "negative payload": ("--payload", "-1", "--payload: out of range (got '-1.0'); kilograms, 0 to 1000"),
    "payload no number": ("--payload", "nan", "--payload: out of range (got 'nan')"),
    "payload in words": ("--payload", "heavy", "--payload: is not a number (got 'heavy')"),
    "payload with its unit": ("--payload", "0.8kg", "--payload: is not a number (got '0.8kg')"),
    "payload of a planet": ("--payload", "1e308", "--payload: out of range (got '1e+308'); kilograms, 0 to 1000"),
    "release": ("--release", "throw", "--release: is not known (got 'throw'); one of 'gripper', 'winch'"),
    "payload infinite": ("--payload", "inf", "--payload: out of range"),
    "naive time": ("--depart", "2013-07-10T14:00", "--depart: the time has no UTC offset"),
    "date alone": ("--depart", "2013-07-10", "--depart: the time has no UTC offset"),
    "nonsense time": (
        "--depart",
        "tomorrow",
        "--depart: not an ISO 8601 time (got 'tomorrow'); write it as 2013-07-10T14",
    ),
    "impossible date": ("--depart", "2013-02-30T14:00Z", "--depart: not an ISO 8601 time"),
    "far future": ("--depart", "9999-12-31T23:00Z", "--depart: out of range"),
    "past the calendar": ("--depart", "9999-12-31T23:00-14:00", "--depart: the time is out of range"),
    "far past": ("--depart", "0001-01-01T00:00Z", "--depart: out of range"),
    "reserve above": ("--reserve", "101", "--reserve: out of range (got '101.0'); percent from 0 to 95"),
    "reserve below": ("--reserve", "-1", "--reserve: out of range"),
    "reserve nan": ("--reserve", "nan", "--reserve: out of range"),
    "soc above": ("--soc", "120", "--soc: out of range (got '120.0'); percent from 0 to 100"),
    "soc nan": ("--soc", "nan", "--soc: out of range"),
    "airspeed 0": ("--airspeed", "0", "--airspeed: out of range (got '0.0'); metres per second"),
    "airspeed nan": ("--airspeed", "nan", "--airspeed: out of range"),
    "wind without direction": ("--wind", "8", "--wind: not a wind (got '8'); write m/s@degrees FROM, such as 8@270"),
    "wind negative": ("--wind", "-8@270", "--wind: not a wind"),
    "wind a hurricane": ("--wind", "800@270", "--wind: out of range"),
    "wind direction": ("--wind", "8@400", "--wind: out of range"),
    "wind nan": ("--wind", "nan@270", "--wind: not a wind"),
    "planner": ("--planner", "best", "--planner: no such planner (got 'best'); one of robust, shortest, pfs"),
    "objective": ("--objective", "fast", "--objective: is not an objective (got 'fast'); mean, p95, energy, cost"),
    "objective in capitals": (
        "--objective",
        "Mean",
        "--objective: is not an objective (got 'Mean'); did you mean mean?",
    ),
    "deadline without offset": ("--objective", "on-time 2013-07-10T16:00", "--objective: the time has no UTC offset"),
    "window in words": ("--depart-window", "soon", "--depart-window: is not a duration (got 'soon'); such as 90min"),
    "deadline gone": ("--objective", "on-time 2001-07-10T16:00Z", "--objective: the deadline is before the departure"),
    "window too long": ("--depart-window", "30h", "--depart-window: out of range (got '30 h'); from 1 min to 24 h"),
    "window without unit": ("--depart-window", "2", "--depart-window: has no unit (got '2'); did you mean 2h or 2min?"),
    "window of seconds": ("--depart-window", "5s", "--depart-window: out of range (got '5 s'); from 1 min"),
    "airspeed in km/h": ("--airspeed", "80", "flies 23 m/s at most (got '80.0'); did you mean 22.2 m/s (80 km/h)?"),
    "airspeed of a jet": ("--airspeed", "100", "--airspeed: m300 flies 23 m/s at most (got '100.0'); up to 23 m/s"),
    "reserve as a fraction": (
        "--reserve",
        "0.2",
        "--reserve: is in percent, and 0.2 % is hardly anything (got '0.2'); did you mean --reserve 20?",
    ),
    "charge as a fraction": (
        "--soc",
        "0.9",
        "--soc: is in percent, and 0.9 % is hardly anything (got '0.9'); did you mean --soc 90?",
    ),
    "package in grams": ("--payload", "1200", "did you mean 1.2?"),
    "mode in capitals": ("--recharge", "FULL", "--recharge: is not known (got 'FULL'); did you mean full?"),
    "deadline before": (
        "--objective",
        "on-time 2013-07-10T13:00-04:00",
        "--objective: the deadline is before the departure (got 'on-time 2013-07-10T13:00-04:00')",
    ),
    "dwell of a day": ("--dwell", "30h", "--dwell: out of range (got '30h'); 0 to 12 h (43200 s)"),
    "deadline next year": (
        "--objective",
        "on-time 2014-07-10T16:00Z",
        "--objective: the deadline is more than 48 h after",
    ),
    "no alternative": ("--alternatives", "0", "--alternatives: out of range (got '0'); 1 or more"),
    "drone": ("--drone", "m100", "--drone: no such drone (got 'm100'); the fleet has m200, m600, m210, m300"),
    "recharge": ("--recharge", "some", "--recharge: is not known (got 'some'); full or enough"),
    "seed negative": ("--seed", "-5", "--seed: out of range (got '-5'); 0 or more"),
    "time limit": ("--time-limit", "0", "--time-limit: must be above 0"),
    "truth in words": ("--actual-wind", "yesterday", "--actual-wind: neither a date nor a file (got 'yesterday')"),
    "truth out of the record": (
        "--actual-wind",
        "2012-07-10",
        "--actual-wind: the record has no complete 48 h of wind for the day (got '2012-07-10'); the record covers 2013-01-01",
    ),
    "truth at the record's end": ("--actual-wind", "2013-12-30", "nearest day without a gap is 2013-12-"),
    "forecast missing": ("--forecast", "nope.csv", "nope.csv: no such file"),
    "picture format": (
        "--plot",
        "x.gif",
        "--plot: is not a picture format (got 'x.gif'); FILE.png, FILE.svg or FILE.pdf",
    ),
    "standard output": (
        "-o",
        "-",
        "-: is not a file, and standard output is not written to; name a file, or use --json",
    ),
    "folder of the output": ("-o", "nowhere/plan.json", "nowhere: no such folder"),
    "start is the end": ("--to", "bellevue", "--to: start and destination are the same"),
    "in a no-fly zone": ("--to", "40.6413,-73.7781", "--to: lies in the no-fly zone John F. Kennedy"),
    "latitude": ("--to", "140.6,-73.7", "--to: latitude out of range (got '140.6')"),
    "longitude": ("--to", "40.6,-273.7", "--to: longitude out of range"),
}


@pytest.mark.parametrize(("option", "value", "message"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_option_is_one_line_that_names_it(refused, option, value, message):
    assert message in refused("plan", *with_(option, value))


@pytest.mark.parametrize("missing", ["--from", "--to", "--payload"])
def test_a_missing_option_is_named(refused, missing):
    at = HOP.index(missing)
    assert f"Missing option '{missing}'" in refused("plan", *HOP[:at], *HOP[at + 2 :])


def test_unknown_commands_and_options_are_usage_errors(refused):
    assert "No such command 'fly-away'" in refused("fly-away")
    assert "No such option: --bogus" in refused("plan", *HOP, "--bogus")
    assert "--hours: out of range (got '100'); 48 or less" in refused("wind", "--hours", "100")
    assert "no such planner (got 'best')" in refused("compare", *HOP, "--planners", "pfs,best")
    assert "no planner named" in refused("compare", *HOP, "--planners", ",")


def test_a_wrong_argument_is_one_line_that_names_it(refused):
    assert "value: is not a number (got 'on')" in refused("params", "set", "RTL_ALT", "on")


@pytest.mark.parametrize(
    "words", [("params", "get"), ("clear",), ("health",), ("logs", "list"), ("params", "save", "a.param")]
)
@pytest.mark.parametrize("number", ["0", "256", "300", "-1"])
def test_what_is_no_mavlink_system_is_refused_before_a_connection_is_opened(refused, words, number):
    told = f"--system: out of range (got '{number}'); 1 to 255"
    assert told in refused(*words, "--system", number, "--connect", "carrier pigeon")


@pytest.mark.parametrize("number", ["0", "256"])
def test_what_is_no_mavlink_system_is_no_ground_station(refused, number):
    assert f"--gcs-system: out of range (got '{number}')" in refused("watch", "--gcs-system", number)


@pytest.mark.parametrize(
    "words",
    [
        ("watch", "--connect", "tcp:127.0.0.1:70000"),
        ("watch", "--connect", "udpout:127.0.0.1:0"),
        ("sim", "--tcp", "70000"),
        ("sim", "--pads", "tcp:127.0.0.1:99999"),
        ("dispatch", "demo", "--port", "70000"),
        ("serve", "--port", "70000"),
    ],
)
def test_what_is_no_port_is_refused(refused, words):
    assert "out of range" in refused(*words)


@pytest.mark.parametrize("level", ["0", "100", "-5", "nan"])
def test_a_level_that_no_or_every_network_reaches_is_refused_before_a_day_is_simulated(refused, level):
    told = refused("study", "capacity", "--level", level)
    assert f"--level: out of range (got '{float(level)}'); percent, above 0 and below 100" in told


def test_a_part_of_a_drone_is_refused(refused):
    told = refused("study", "capacity", "--drones", "20.7,20.2")
    assert "--drones: are not such numbers (got '20.7,20.2'); whole numbers from 1 to 10000" in told


def test_wind_and_forecast_exclude_each_other(refused):
    assert "--wind and --forecast exclude each other" in refused("plan", *HOP, "--wind", "8@270", "--forecast", "x.csv")


def test_infeasible_requests_end_with_1_and_name_what_binds(refused):
    assert "no drone lifts 80 kg: the fleet's heaviest payload is 6 kg" in refused(
        "plan", *with_("--payload", "80"), code=1
    )
    far = refused("plan", *with_("--to", "51.5,-0.1"), code=1)
    assert "no segment joins it; the nearest station, syosset, is 5547.8 km away" in far
    assert "lat and lon look swapped" in refused("plan", *with_("--to", "-73.93,40.75"), code=1)
    storm = refused("plan", *HOP, "--wind", "20@270", code=1)
    assert "no route from bellevue to jacobi" in storm
    assert "wind" in storm
    slow = refused("plan", *TRIP, "--drone", "m200", "--airspeed", "6", "--wind", "1@0", code=1)
    assert "% of the battery of m200" in slow
    empty = refused("plan", *TRIP, "--drone", "m200", "--reserve", "90", code=1)
    assert "the reserve of 90 %" in empty


def test_a_network_in_parts_is_named_as_the_reason(skyway, refused, tmp_path):
    assert skyway("scenario", "init", "apart").code == 0
    file = tmp_path / "apart" / "scenario.toml"
    file.write_text(file.read_text().replace("max_length_m = 16000", "max_length_m = 7500"))
    request = ("--from", "depot", "--to", "clinic", "--payload", "1", "--depart", "2025-06-15T12:00+02:00")
    assert "no chain of segments joins them" in refused("plan", "apart", *request, code=1)


def test_a_scenario_that_is_not_there_says_how_to_begin_one(refused, tmp_path):
    assert "nowhere: no such folder; skyway scenario init DIR writes one" in refused("plan", "nowhere", *HOP)
    (tmp_path / "empty").mkdir()
    assert "empty: the folder has no scenario.toml" in refused("plan", "empty", *HOP)
    assert "no such folder" in refused("network", "nowhere")
    assert "no such folder" in refused("wind", "nowhere")
    assert "no such folder" in refused("scenario", "check", "nowhere")


def test_nothing_is_overwritten_and_nothing_half_written(skyway, refused, tmp_path):
    (tmp_path / "taken.json").write_text("mine")
    assert "taken.json: exists already; give another name, or --force" in refused("plan", *HOP, "-o", "taken.json")
    assert (tmp_path / "taken.json").read_text() == "mine"
    assert "is a folder; name a file" in refused("plan", *HOP, "-o", ".")
    assert "is named for two outputs" in refused("plan", *HOP, "-o", "x.svg", "--plot", "x.svg")
    assert "no such folder" in refused("network", "--geojson", "nowhere/net.geojson")
    assert "taken.json: exists already and is not an empty folder" in refused("scenario", "init", "taken.json")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_refused_before_planning(refused, tmp_path):
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o500)
    assert "cannot be written to" in refused("plan", *HOP, "-o", "locked/plan.json")


def rows(*lines: str) -> str:
    return "\n".join((FORECAST_HEADER, *lines)) + "\n"


GOOD = [f"2013-07-10T{hour}:00Z,{site},a,4,200" for hour in (18, 19) for site in ("EWR", "JFK", "LGA")]
FORECASTS = {
    "empty": ("", "f.csv: is empty"),
    "header alone": (rows(), "no rows"),
    "column missing": ("time,site,member,speed_mps\n", "from_deg"),
    "speed in words": (rows(*GOOD[1:], "2013-07-10T18:00Z,EWR,a,brisk,200"), "speed_mps"),
    "speed nan": (rows(*GOOD[1:], "2013-07-10T18:00Z,EWR,a,nan,200"), "speed_mps"),
    "speed negative": (rows(*GOOD[1:], "2013-07-10T18:00Z,EWR,a,-4,200"), "not a wind speed"),
    "direction": (rows(*GOOD[1:], "2013-07-10T18:00Z,EWR,a,4,720"), "from_deg"),
    "naive time": (rows(*GOOD[1:], "2013-07-10T18:00,EWR,a,4,200"), "no UTC offset"),
    "unknown site": (rows(*GOOD[1:], "2013-07-10T18:00Z,BOS,a,4,200"), "the sites are EWR, JFK, LGA"),
    "row missing": (rows(*GOOD[1:]), "member a, site EWR, 2013-07-10T18:00:00Z is missing"),
    "row twice": (rows(*GOOD, GOOD[0]), "is given twice"),
    "no member": (rows(*GOOD[1:], "2013-07-10T18:00Z,EWR,,4,200"), "no member"),
    "other day": (rows(*(row.replace("2013-07-10", "2013-07-12") for row in GOOD)), "does not cover the departure"),
    "no text": ("\x00\x01\x02", ""),
}


@pytest.mark.parametrize(("text", "message"), FORECASTS.values(), ids=FORECASTS.keys())
def test_a_wrong_forecast_file_is_named_with_its_line(skyway, tmp_path, text, message):
    (tmp_path / "f.csv").write_text(text)
    answer = skyway("plan", *HOP, "--forecast", "f.csv", "-o", "plan.json")
    assert answer.code == 2, answer
    assert answer.out == ""
    assert message in answer.err
    assert all(line.startswith("skyway: f.csv") for line in answer.err.splitlines())
    assert not (tmp_path / "plan.json").exists()


def test_a_forecast_of_several_members_is_no_truth(refused, tmp_path):
    both = [*GOOD, *(row.replace(",a,", ",b,") for row in GOOD)]
    (tmp_path / "f.csv").write_text(rows(*both))
    assert "the actual wind has more than one member" in refused(
        "plan", *HOP, "--planner", "ies", "--actual-wind", "f.csv"
    )


@pytest.mark.parametrize("name", ["stations.csv", "wind.csv", "load.csv", "forecast.csv"])
def test_a_file_of_200_mb_is_refused_by_its_size(skyway, tmp_path, name):
    assert skyway("scenario", "init", "big").code == 0
    with (tmp_path / "big" / name).open("r+b" if name != "forecast.csv" else "wb") as stream:
        stream.truncate(200_000_000)  # sparse: takes no room
    request = ("--from", "depot", "--to", "clinic", "--payload", "1", "--depart", "2025-06-15T12:00+02:00")
    more = ("--forecast", "big/forecast.csv") if name == "forecast.csv" else ()
    answer = skyway("plan", "big", *request, *more)
    assert answer.code == 2
    assert name in answer.err
    assert "is larger than" in answer.err
    assert len(answer.err.splitlines()) == 1
