"""After a flight its logs are fetched, only these, and whatever goes wrong is told in a line."""

import json

import pytest
from wires import FAMILIES, Scene, bad_radio

from skyway.link.files.aboard import LogStore
from skyway.link.files.catalog import known_logs
from skyway.link.files.fetching import fetch
from skyway.link.files.flight_logs import fetch_added, logs_before
from skyway.link.vehicle.vehicle import Vehicle
from skyway.models.base.errors import CommandRefusedError, InputError
from skyway.sim_stub.faults import parse_fault

EARLIER = (1000, 3000)


class Hangar(Scene):
    """A vehicle with two logs of earlier flights, which writes its own."""

    def __init__(self, family="px4", **how):
        super().__init__(family, logs=EARLIER, log_room_bytes=2_000_000, **how)
        self.craft = Vehicle(self.connection)
        self.craft.request_telemetry()
        self.told = []

    def hops(self):
        """Arm, and disarm: what a log needs."""
        craft = self.craft
        if craft.family.arms_in is not None:
            craft.set_mode(craft.family.arms_in)
        craft.arm(60.0)
        self.connection.run_for(2.0)
        craft.disarm()
        self.connection.run_for(3.0)

    def fault(self, text):
        self.vehicle.faults.add(parse_fault(text), self.vehicle.sim_s)
        self.connection.run_for(0.1)

    def newest(self):
        return bytes(list(self.vehicle.card.files.values())[-1].content)

    def fetch(self, before, folder, flight=()):
        self.told.clear()
        return fetch_added(self.craft, before, folder, flight, self.told.append)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_the_log_of_the_flight_is_fetched_and_no_other(family, loss, tmp_path):
    hangar = Hangar(family, impairment=bad_radio(loss))
    before = logs_before(hangar.craft)
    assert sorted(before.sizes.values()) == list(EARLIER)
    hangar.hops()
    (found,) = hangar.fetch(before, tmp_path, [tmp_path / "a.tlog", tmp_path / "a.jsonl"])
    assert found.path.read_bytes() == hangar.newest()
    assert hangar.told[-1].startswith("log fetched: ")
    (known,) = known_logs(tmp_path)
    assert known.recordings == ("a.tlog", "a.jsonl")
    assert known.log == found.path.name


def test_ardupilots_log_that_goes_on_is_gone_on_with(tmp_path):
    hangar = Hangar("ardupilot")
    before = logs_before(hangar.craft)
    hangar.hops()
    (first,) = hangar.fetch(before, tmp_path)
    before = logs_before(hangar.craft)
    hangar.hops()
    (second,) = hangar.fetch(before, tmp_path)
    assert second.path == first.path
    assert second.came_bytes == second.size_bytes - first.size_bytes > 0
    assert second.path.read_bytes() == hangar.newest()


def test_a_file_that_is_no_beginning_of_the_log_is_kept(tmp_path):
    hangar = Hangar("ardupilot")
    hangar.hops()
    store = LogStore(hangar.craft)
    log = store.logs()[-1]
    (tmp_path / "vehicle1-00000003.bin").write_bytes(b"of another vehicle " * 50)
    with pytest.raises(InputError, match="it is not its beginning"):
        fetch(store, log, tmp_path)
    changed = bytearray(hangar.newest()[:2000])
    changed[1000] ^= 0xFF
    (tmp_path / "vehicle1-00000003.bin").write_bytes(changed)
    with pytest.raises(InputError, match="it is not its beginning"):
        fetch(store, log, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["vehicle1-00000003.bin"]


@pytest.mark.parametrize("family", FAMILIES)
def test_what_is_not_known_before_has_the_latest_fetched(family, tmp_path):
    hangar = Hangar(family)
    hangar.hops()
    (found,) = hangar.fetch(None, tmp_path)
    assert found.path.read_bytes() == hangar.newest()


def test_an_armed_vehicle_is_left_in_peace(tmp_path):
    hangar = Hangar("px4")
    before = logs_before(hangar.craft)
    hangar.craft.arm(60.0)
    with pytest.raises(CommandRefusedError):
        logs_before(hangar.craft)
    assert hangar.fetch(before, tmp_path) == []
    assert hangar.told == ["log not fetched: the vehicle is armed; run skyway logs fetch when it is disarmed"]


@pytest.mark.parametrize("fault", ["log-stall", "log-gone", "link-loss"])
def test_what_goes_wrong_is_one_line(fault, tmp_path):
    hangar = Hangar("px4")
    before = logs_before(hangar.craft)
    hangar.hops()
    hangar.fault(fault)
    assert hangar.fetch(before, tmp_path) == []
    (line,) = hangar.told
    assert line.startswith("log not fetched: ")
    assert "\n" not in line


def test_no_new_log_is_told(tmp_path):
    hangar = Hangar("px4")
    assert hangar.fetch(logs_before(hangar.craft), tmp_path) == []
    assert "has no new log" in hangar.told[0]


def test_a_file_in_the_way_keeps_no_other_from_coming(tmp_path):
    hangar = Hangar("px4")
    before = logs_before(hangar.craft)
    hangar.hops()
    hangar.hops()
    first, second = (log.name for log in LogStore(hangar.craft).logs() if log.name not in before.sizes)
    (tmp_path / f"vehicle1-{first.replace('/', '-')}").write_bytes(b"x" * 10_000_000)
    (found,) = hangar.fetch(before, tmp_path)
    assert found.path.name.endswith(second.split("/")[1])
    assert "exists already" in hangar.told[0]
    assert json.loads((tmp_path / "logs-fetched.jsonl").read_text())["log"] == found.path.name


def test_ctrl_c_ends_the_transfer_alone(tmp_path, monkeypatch):
    hangar = Hangar("px4")
    before = logs_before(hangar.craft)
    hangar.hops()

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(LogStore, "read", interrupted)
    assert hangar.fetch(before, tmp_path) == []
    assert hangar.told == ["log not fetched: interrupted; continue with skyway logs fetch"]
