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

from missions.examples import NEW_YORK
from models.scenario_file import read_scenario
from sim_stub.fleet import FleetOptions, build_world, serve
from sim_stub.transports.urls import parse_address
from sim_stub.wind_truth import ConstantWind

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
    assert not (tmp_path / "recordings").exists()


def test_a_plan_of_another_scenario_is_not_flown(planned, tmp_path):
    plan = json.loads((tmp_path / "plan.json").read_text())
    plan["scenario"]["sha256"] = "0" * 64
    (tmp_path / "other.json").write_text(json.dumps(plan))
    answer = planned("fly", "other.json", *NOBODY)
    assert answer.code == 2
    assert "not the one that the plan was made in" in answer.err


def test_demo_plans_without_flying_and_refuses_what_is_no_day(skyway):
    answer = skyway("demo", "--plan-only", "--planner", "pfs-charge-aware")
    assert answer.code == 0
    assert "siuh-north" in answer.out
    assert skyway("demo", "--day", "yesterday").code == 2


class Served:
    """A simulated vehicle with pads on sockets, twenty times faster than life."""

    def __init__(self, autopilot):
        scenario = read_scenario(NEW_YORK)
        place = scenario.network.stations[scenario.network.index["bellevue"]]
        options = FleetOptions(
            stations=scenario.network.stations, places=(place,), autopilot=autopilot, drone=scenario.drone("m200"),
            payload_kg=0.8, warm=True, wind=ConstantWind(2.0, 1.0),
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


def fly_command(there, *more):
    return [
        sys.executable, "-m", "skyway", "fly", "plan.json", "--connect", f"tcp:127.0.0.1:{there.port}", "--pads", there.pads,
        "--journal", "j.jsonl", "--record", "recordings", "--planner", "pfs-charge-aware", *more,
    ]  # fmt: skip


@pytest.mark.slow
def test_manual_asks_at_the_terminal_before_the_take_off_and_again_for_what_is_no_answer(planned, tmp_path):
    with Served("px4") as there:
        asked = [("yes or no?", "perhaps\n"), ("please answer", "yes\n")]
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
    assert "does not allow the take-off" in said


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_ctrl_c_twice_leaves_it_to_its_parameters_and_says_what_they_make_it_do(autopilot, planned, tmp_path):
    with Served(autopilot) as there:
        keys = [("yes or no?", "yes\n"), ("in the air", "\x03"), ("Ctrl-C again", "\x03")]
        code, said = typed(fly_command(there), keys, tmp_path)
        assert code == 3, said
        assert "left to itself; it finishes its mission, lands and disarms there" in said
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
