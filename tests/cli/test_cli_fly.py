"""``fly`` and ``demo``: what is refused, and a delivery over sockets at wall time."""

import json
import os
import pty
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from datetime import datetime

import pytest
from sim_serving import free_port

from skyway.missions.examples import NEW_YORK
from skyway.models.scenario.file import read_scenario
from skyway.sim_stub.faults import parse_fault
from skyway.sim_stub.fleet import FleetOptions, build_world, serve
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.urls import parse_address

PLAN = ("plan", "--from", "bellevue", "--to", "city-hall", "--payload", "0.8", "--drone", "m200", "--planner", "shortest",
        "--depart", "2013-07-10T14:00-04:00", "-o", "plan.json")  # fmt: skip
NOBODY = ("--connect", "udpin:127.0.0.1:0")


@pytest.fixture
def planned(skyway):
    assert skyway(*PLAN).code == 0
    return skyway


def test_a_plan_that_is_not_there_and_options_that_exclude_each_other_are_refused(refused):
    assert "no such file" in refused("fly", "nothing.json", *NOBODY)


def test_what_is_typed_wrongly_is_refused_before_anything_is_opened(planned, tmp_path):
    def told(*arguments):
        answer = planned("fly", "plan.json", *NOBODY, *arguments)
        assert answer.code == 2, answer
        assert answer.out == ""
        return answer.err

    assert "exclude each other" in told("--manual", "--yes")
    assert "exclude each other" in told("--journal", "a.jsonl", "--resume", "b.jsonl")
    assert "no such station" in told("--elevation", "nowhere=12")
    assert "not a height" in told("--elevation", "bellevue=high")
    assert "no such file" in told("--drag", "drag.toml")
    assert "no such file" in told("--resume", "nowhere.jsonl")
    (tmp_path / "there.jsonl").write_text("")
    assert "exists already" in told("--journal", "there.jsonl")
    assert "exclude each other" in told("--keep-parameters", "--no-restore")
    assert "no such planner" in told("--planner", "fastest")
    assert "a flight does not have" in told("--planner", "exact")
    assert "--wind" in told("--wind", "strong")
    assert "no such file" in told("--forecast", "nowhere.csv")
    assert "--pads" in told("--pads", "udp:here")
    assert not (tmp_path / "recordings").exists()


def test_forecasts_of_elsewhere_and_a_closed_destination_are_refused_before_anything_is_opened(planned, tmp_path):
    def told(*arguments):
        answer = planned("fly", "plan.json", *NOBODY, *arguments)
        assert answer.code == 2, answer
        assert answer.err.count("\n") == 1
        return answer.err

    where = {"latitude": 40.7, "longitude": -73.9, "utc_offset_seconds": 0}
    hourly = {
        "time": ["2013-07-10T18:00", "2013-07-10T19:00"],
        "wind_speed_80m": [5.0, 5.0],
        "wind_direction_80m": [270, 270],
    }
    units = {"time": "iso8601", "wind_speed_80m": "m/s", "wind_direction_80m": "°"}
    found = {"hourly_units": units, "hourly": hourly}
    (tmp_path / "away.json").write_text(json.dumps({**where, **found, "latitude": 52.3, "longitude": 4.9}))
    (tmp_path / "swapped.json").write_text(json.dumps({**where, **found, "latitude": -73.9, "longitude": 40.7}))
    del hourly["wind_direction_80m"]
    (tmp_path / "speed.json").write_text(json.dumps({**where, **found}))
    assert "away.json: does not cover the region" in told("--forecast", "away.json")
    assert "look swapped" in told("--forecast", "swapped.json")
    assert "no direction: unusable for planning" in told("--forecast", "speed.json")
    ring = [[-74.02, 40.70], [-73.99, 40.70], [-73.99, 40.73], [-74.02, 40.73], [-74.02, 40.70]]
    zone = {
        "type": "Feature",
        "properties": {"id": "HALL", "kind": "prohibited"},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    (tmp_path / "zone.json").write_text(json.dumps({"type": "FeatureCollection", "features": [zone]}))
    assert "zone.json: the place of delivery, city-hall, lies in the zone HALL" in told("--zones", "zone.json")


def test_what_only_a_person_could_answer_is_refused_where_nobody_is_listened_to(skyway, tmp_path):
    longer = list(PLAN)
    longer[longer.index("city-hall")] = "jacobi"
    assert skyway(*longer).code == 0
    answer = skyway("fly", "plan.json", *NOBODY, "--pads", "manual", "--yes")
    assert answer.code == 2
    assert "nobody could confirm the charging" in answer.err
    assert "--pads tcp:HOST:PORT" in answer.err
    answer = skyway("fly", "plan.json", *NOBODY, "--pads", "tcp:127.0.0.1:1", "--yes", "--release", "hand")
    assert answer.code == 2
    assert "package was taken off" in answer.err
    assert not (tmp_path / "recordings").exists()


def test_a_plan_of_another_scenario_is_not_flown(planned, tmp_path):
    plan = json.loads((tmp_path / "plan.json").read_text())
    plan["scenario"]["sha256"] = "0" * 64
    (tmp_path / "other.json").write_text(json.dumps(plan))
    answer = planned("fly", "other.json", *NOBODY)
    assert answer.code == 2
    assert "the scenario differs from the plan's" in answer.err


def journal_of(path, composition, state, reason):
    start = {"n": 1, "time": "2013-07-10T18:00:00Z", "state": "connecting", "event": "start"}
    start["data"] = {"schema": "skyway.journal/1", "composition": composition}
    last = {"n": 2, "time": "2013-07-10T18:20:00Z", "state": state, "event": "state", "reason": reason}
    last["data"] = {"before": "landed", "after": state}
    path.write_text("".join(json.dumps(one) + "\n" for one in (start, last)))


def test_only_the_delivery_of_the_journal_is_resumed_and_none_that_has_arrived(planned, tmp_path):
    plan = json.loads((tmp_path / "plan.json").read_text())

    def told(composition, state):
        journal_of(tmp_path / "j.jsonl", composition, state, "delivered at city-hall")
        return planned("fly", "plan.json", *NOBODY, "--resume", "j.jsonl", "--forecast", "nowhere.csv").err

    assert "is of another delivery: bellevue to jacobi, not bellevue to city-hall" in told(
        plan | {"to": "jacobi"}, "stopped-safe"
    )
    assert "its departure, drone or package differ" in told(plan | {"payload_kg": 0.5}, "stopped-safe")
    assert "ended at 2013-07-10T18:20:00Z: delivered at city-hall" in told(plan, "delivered")
    assert "no such file" in told(plan, "stopped-safe"), (
        "the same delivery, not yet arrived, comes as far as the forecast"
    )


def test_demo_plans_without_flying_and_refuses_what_is_no_day(skyway):
    answer = skyway("demo", "--plan-only", "--planner", "pfs-charge-aware")
    assert answer.code == 0
    assert "siuh-north" in answer.out
    assert skyway("demo", "--day", "yesterday").code == 2


class Served:
    """A simulated vehicle with pads on sockets, twenty times faster than life."""

    def __init__(self, autopilot, faults=()):
        scenario = read_scenario(NEW_YORK)
        place = scenario.network.stations[scenario.network.index["bellevue"]]
        options = FleetOptions(
            stations=scenario.network.stations, places=(place,), autopilot=autopilot, drone=scenario.drone("m200"),
            payload_kg=0.8, warm=True, wind=ConstantWind(2.0, 1.0), log_room_bytes=20_000_000, faults=tuple(map(parse_fault, faults)),
            epoch_s=datetime.fromisoformat("2013-07-10T14:00-04:00").timestamp(),
        )  # fmt: skip
        self.world = build_world(options)
        self.port, pads = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_STREAM)
        self.pads = f"tcp:127.0.0.1:{pads}"
        self.loop, _ = serve(
            self.world, tcp_port=self.port, pads=parse_address(self.pads, option="--pads", kinds=("tcp",)), speedup=20.0
        )
        self.thread = threading.Thread(target=self.loop.run, daemon=True)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.loop.stop()
        self.thread.join(10.0)


@pytest.mark.slow
@pytest.mark.parametrize("driver", ["pymavlink", "mavsdk"])
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("run", range(5))
def test_a_delivery_at_wall_time_over_sockets(autopilot, driver, run, planned, tmp_path):
    if driver == "mavsdk":
        pytest.importorskip("mavsdk")
    elif run:
        pytest.skip("once is enough: the lockstep proofs fly this driver")
    with Served(autopilot) as there:
        answer = planned(
            "fly", "plan.json", "--connect", f"tcp:127.0.0.1:{there.port}", "--pads", there.pads, "--yes",
            "--driver", driver, "--journal", "j.jsonl", "--record", "recordings", "--planner", "pfs-charge-aware",
        )  # fmt: skip
        assert answer.code == 0, answer
        assert there.world.vehicles[1].station() == "city-hall"
        assert there.world.vehicles[1].body.payload_kg == 0.0
    assert "delivered at city-hall" in answer.out
    assert list((tmp_path / "recordings").glob("*.tlog"))


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_the_logs_of_a_delivery_come_home_and_are_replayed_from_its_recording(autopilot, planned, tmp_path):
    with Served(autopilot) as there:
        answer = planned(
            "fly", "plan.json", "--connect", f"tcp:127.0.0.1:{there.port}", "--pads", there.pads, "--yes", "--fetch-log",
            "--record", "recordings",
        )  # fmt: skip
        assert answer.code == 0, answer
        card = there.world.vehicles[1].card
    flown = [bytes(file.content) for file in card.files.values()]
    fetched = [tmp_path / line.split()[2].rstrip(",") for line in answer.out.splitlines() if "log fetched:" in line]
    assert sorted(path.read_bytes() for path in fetched) == sorted(flown)
    (recording,), (journal,) = ((tmp_path / "recordings").glob(form) for form in ("*.tlog", "*city-hall*.jsonl"))
    told = planned("replay", recording)
    assert fetched[0].name in told.err
    for named in (recording, journal):
        full = planned("replay", named, "--aboard", "1")
        assert full.code == 0, full
        assert fetched[0].name in full.out.splitlines()[0]
        assert "leg 1" in full.out


@pytest.mark.slow
def test_logs_that_do_not_come_leave_a_delivery_delivered(planned, tmp_path):
    with Served("px4", faults=["log-gone@T+60s"]) as there:
        answer = planned(
            "fly", "plan.json", "--connect", f"tcp:127.0.0.1:{there.port}", "--pads", there.pads, "--yes", "--fetch-log",
            "--journal", "j.jsonl", "--record", "recordings", "--json",
        )  # fmt: skip
    assert answer.code == 0, answer
    assert answer.out.count("log not fetched") + answer.err.count("log not fetched") == 1
    assert json.loads(answer.out.splitlines()[-1])["logs"] == []


def typed(command, answers, cwd, longest_s=240.0):
    """Run a command at a terminal of its own, and answer what it asks: pairs of a text to wait for and what is typed then."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(cwd)
        os.execv(command[0], command)
    said, waiting, end = "", list(answers), time.monotonic() + longest_s
    heard = 0
    while time.monotonic() < end:
        if not select.select([terminal], [], [], 1.0)[0]:
            continue
        try:
            piece = os.read(terminal, 4096)
        except OSError:
            break  # it has ended
        if not piece:
            break
        said += piece.decode(errors="replace")
        if waiting and waiting[0][0] in said[heard:]:
            heard = len(said)
            os.write(terminal, waiting.pop(0)[1].encode())
    else:
        os.kill(pid, signal.SIGKILL)
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    os.close(terminal)
    assert not waiting, said
    return code, said


def held(there):
    store = there.world.vehicles[1].autopilot.parameters
    found = {one.name: one.value for one in map(store.at, range(len(store)))}
    return {name: value for name, value in found.items() if not name.endswith("_TOTAL")}  # what it counts itself


def fly_command(there, *more):
    return [
        sys.executable, "-m", "skyway", "fly", "plan.json", "--connect", f"tcp:127.0.0.1:{there.port}", "--pads", there.pads,
        "--journal", "j.jsonl", "--record", "recordings", "--planner", "pfs-charge-aware", *more,
    ]  # fmt: skip


@pytest.mark.slow
def test_manual_asks_at_the_terminal_before_the_take_off_and_again_for_what_is_no_answer(planned, tmp_path):
    with Served("px4") as there:
        asked = [("yes or no?", "perhaps\n"), ("Please answer", "yes\n")]
        code, said = typed(fly_command(there, "--manual"), asked, tmp_path)
    assert code == 0, said
    assert "delivered at city-hall" in said
    assert "expected" in said  # the live table


@pytest.mark.slow
def test_no_is_an_answer_too_and_leaves_it_where_it_stands(planned, tmp_path):
    with Served("ardupilot") as there:
        code, said = typed(fly_command(there), [("yes or no?", "no\n")], tmp_path)
        assert there.world.vehicles[1].station() == "bellevue"
        assert not there.world.vehicles[1].autopilot.armed
    assert code == 1, said
    assert "said no to the take-off" in said


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_ctrl_c_twice_leaves_it_to_its_parameters_and_says_what_they_make_it_do(autopilot, planned, tmp_path):
    with Served(autopilot) as there:
        keys = [("yes or no?", "yes\n"), ("fly the leg", "\x03"), ("Ctrl-C again", "\x03")]
        code, said = typed(fly_command(there), keys, tmp_path)
        assert code == 3, said
        assert "leaves the drone to itself; it finishes its mission, lands and disarms there" in said
        end = time.monotonic() + 120.0
        while there.world.vehicles[1].autopilot.armed and time.monotonic() < end:
            time.sleep(0.5)
        assert there.world.vehicles[1].station() == "city-hall"  # and so it does


@pytest.mark.slow
def test_json_is_a_record_a_line_and_the_outcome_at_the_end(planned, tmp_path):
    with Served("px4") as there:
        run = subprocess.run(
            fly_command(there, "--yes", "--json"),
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=240.0,
            check=False,
        )
    assert run.returncode == 0, run.stderr
    *records, outcome = map(json.loads, run.stdout.splitlines())
    assert [record["n"] for record in records] == list(range(1, len(records) + 1))
    assert records[-1]["event"] == "end"
    assert outcome["schema"] == "skyway.fly/1"
    assert outcome["delivered"] is True
    assert outcome["station"] == "city-hall"
    assert "landed at city-hall" in run.stderr


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_from_a_pipe_that_has_ended_nobody_can_answer_and_that_is_said_at_once(autopilot, planned, tmp_path):
    with Served(autopilot) as there:
        begun = time.monotonic()
        run = subprocess.run(
            fly_command(there), cwd=tmp_path, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120.0, check=False
        )  # fmt: skip
        assert time.monotonic() - begun < 60.0
        assert there.world.vehicles[1].station() == "bellevue"
    assert run.returncode == 2
    assert "take-offs cannot be confirmed" in run.stderr


@pytest.mark.slow
def test_a_yes_from_a_pipe_is_an_answer_and_all_it_answers_to_stands_before_it(planned, tmp_path):
    with Served("px4") as there:
        run = subprocess.run(
            fly_command(there), cwd=tmp_path, input="yes\n", capture_output=True, text=True, timeout=240.0, check=False
        )
    assert run.returncode == 0, run.stdout + run.stderr
    before = run.stdout.split("yes or no?")[0]
    for word in (
        "connecting",
        "home: ok",
        "wind: ok",
        "divert stations on the way",
        "MPC_XY_VEL_MAX 12 > 20",
        "link to skyway lost",
        "EDT",
    ):
        assert word in before, word
    assert "parameters restored and read back" in run.stdout
    assert "\x1b" not in run.stdout


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_ctrl_c_before_the_answer_leaves_it_on_the_ground_and_the_terminal_as_it_was(autopilot, planned, tmp_path):
    with Served(autopilot) as there:
        before = held(there)
        code, said = typed(fly_command(there), [("yes or no?", "\x03")], tmp_path)
        assert not there.world.vehicles[1].autopilot.armed
        assert held(there) == before
    assert code == 1, said
    assert "Ctrl-C: the drone stays at bellevue, disarmed" in said


@pytest.mark.slow
def test_ctrl_c_while_it_connects_ends_it_at_once(planned, tmp_path):
    command = fly_command(type("", (), {"port": 1, "pads": "tcp:127.0.0.1:1"}))
    command[command.index("--connect") + 1] = f"udpin:127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    code, said = typed(command, [("connecting", "\x03")], tmp_path, 60.0)
    assert code == 130, said
    assert "interrupted" in said


@pytest.mark.slow
def test_the_panel_lives_before_the_vehicle_is_found(planned, tmp_path):
    command = fly_command(type("", (), {"port": 1, "pads": "tcp:127.0.0.1:1"}))
    command[command.index("--connect") + 1] = f"udpin:127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    code, said = typed(command, [], tmp_path, 60.0)
    assert code == 3, said
    assert "(0:00:03)" in said  # it counts the seconds
    assert "no heartbeat" in said
