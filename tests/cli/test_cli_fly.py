"""``fly`` and ``demo``: what is refused, and a delivery over sockets at wall time."""

import json
import socket
import threading
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
