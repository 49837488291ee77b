"""Sets of parameters: saved, compared, asked for and restored, typed and in virtual time, on both autopilots."""

import io
import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sim_serving import served
from wires import FAMILIES, Scene, bad_radio

from skyway.cli.main import main
from skyway.link.files.aboard import LogStore
from skyway.link.protocol.mission_words import MissionKind
from skyway.link.protocol.parameter_set import compare_set, read_set, set_text
from skyway.link.protocol.parameters import REAL32, ParameterValue
from skyway.link.supervisor.journal.entries import ParameterNote
from skyway.link.supervisor.journal.file import SCHEMA, Journal
from skyway.link.vehicle.parameter_restore import restore_set
from skyway.link.vehicle.vehicle import Vehicle
from skyway.missions.autopilots.registry import family_named
from skyway.models.base.errors import CommandRefusedError, InputError, VehicleTimeoutError
from skyway.sim_stub.faults import parse_fault

CHANGED = {"px4": ("MPC_XY_CRUISE", 7.5), "ardupilot": ("RTL_ALT", 4200.0)}
TWO = {"px4": "MPC_XY_CRUISE,6\nRTL_RETURN_ALT,70\n", "ardupilot": "RTL_ALT,4200\nWPNAV_SPEED,700\n"}
"""Sets of two parameters, neither as the simulator has it."""


class Terminal(io.StringIO):
    """Somebody who types."""

    def isatty(self):
        return True


@pytest.fixture
def run(tmp_path, capsys):
    def go(there, *words):
        where = ["--connect", f"tcp:127.0.0.1:{there.where()[1]}", "--system", "1", "--record", str(tmp_path / "rec")]
        code = main([*map(str, words), *where])
        told = capsys.readouterr()
        return code, told.out, told.err

    return go


class Aboard(Scene):
    """A simulated vehicle, our driver aboard, and a set to give it."""

    def __init__(self, family, folder, text=None, **how):
        super().__init__(family, **how)
        self.craft = Vehicle(self.connection)
        self.parameters = self.vehicle.autopilot.parameters
        file = folder / "a.param"
        file.write_text(TWO[family] if text is None else text)
        self.difference = compare_set(read_set(file), self.craft.parameters(), self.craft.family)
        self.done = {}

    def restore(self):
        return restore_set(self.craft, self.difference.changes, lambda c, what: self.done.update({c.name: what}))


@pytest.mark.parametrize(("autopilot", "ending"), [("px4", "params"), ("ardupilot", "param")])
def test_a_set_is_saved_shown_and_restored(run, tmp_path, autopilot, ending):
    file = tmp_path / f"before.{ending}"
    name, value = CHANGED[autopilot]
    with served(tcp_port=0, autopilot=autopilot) as there:
        store = there.world.vehicles[1].autopilot.parameters
        before = store[name]
        assert run(there, "params", "save", file)[0] == 0
        code, _, err = run(there, "params", "save", file)
        assert (code, "exists already" in err) == (2, True)
        store.set(name, value)
        code, out, _ = run(there, "params", "restore", file)
        assert code == 0
        assert f"{name}: {value:.9g} -> {before:.9g}" in out
        assert "add --yes" in out
        assert store[name] == value
        code, out, _ = run(there, "params", "restore", file, "--yes", "--json")
        told = json.loads(out)
        assert (code, [row["done"] for row in told["parameters"]]) == (0, ["set"])
        assert store[name] == before


def test_at_a_terminal_it_shows_first_and_asks_once(run, tmp_path, monkeypatch):
    file = tmp_path / "a.param"
    file.write_text(TWO["px4"])
    with served(tcp_port=0, autopilot="px4") as there:
        store = there.world.vehicles[1].autopilot.parameters
        monkeypatch.setattr("sys.stdin", Terminal("n\n"))
        code, out, _ = run(there, "params", "restore", file)
        assert code == 0
        assert out.index("MPC_XY_CRUISE: 5 -> 6") < out.index("set 2 parameters?") < out.index("nothing was changed")
        assert store["MPC_XY_CRUISE"] == 5.0
        monkeypatch.setattr("sys.stdin", Terminal("y\n"))
        code, out, _ = run(there, "params", "restore", file)
        assert code == 0
        assert out.count("set and read back") == 2
        assert (store["MPC_XY_CRUISE"], store["RTL_RETURN_ALT"]) == (6.0, 70.0)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_each_is_set_and_read_back(family, loss, tmp_path):
    scene = Aboard(family, tmp_path, impairment=bad_radio(loss))
    assert scene.restore() == ""
    assert set(scene.done.values()) == {"set"}
    assert all(scene.parameters[one.name] == one.then for one in scene.difference.changes)


@pytest.mark.parametrize("family", FAMILIES)
def test_what_is_refused_is_told_and_the_next_is_set(family, tmp_path):
    scene = Aboard(family, tmp_path)
    refused, other = (change.name for change in scene.difference.changes)
    take = scene.parameters.set
    scene.parameters.set = lambda name, value: name != refused and take(name, value)
    assert f"set {refused} to" in scene.restore()
    assert scene.done == {refused: "refused", other: "set"}


@pytest.mark.parametrize("family", FAMILIES)
def test_an_armed_vehicle_keeps_what_it_has(family, tmp_path):
    scene = Aboard(family, tmp_path)
    before = [scene.parameters[one.name] for one in scene.difference.changes]
    if scene.craft.family.arms_in is not None:
        scene.craft.set_mode(scene.craft.family.arms_in)
    scene.craft.arm(60.0)
    assert "the vehicle is armed" in scene.restore()
    assert set(scene.done.values()) == {"not reached"}
    assert [scene.parameters[one.name] for one in scene.difference.changes] == before


def test_a_lost_link_leaves_the_rest_and_says_which(tmp_path):
    scene = Aboard("px4", tmp_path)
    take = scene.parameters.set

    def taken_then_silent(name, value):
        scene.vehicle.faults.add(parse_fault("link-loss"), scene.vehicle.sim_s)
        return take(name, value)

    scene.parameters.set = taken_then_silent
    assert "did not answer" in scene.restore()
    first, second = scene.difference.changes
    assert scene.parameters[first.name] == first.then
    assert scene.done == {first.name: "unknown", second.name: "not reached"}


def test_a_parameter_that_went_away_meanwhile_is_told(tmp_path):
    scene = Aboard("ardupilot", tmp_path, firmware="4.8", text="RTL_ALT_M,42\n")
    find = scene.parameters.find
    scene.parameters.find = lambda name: None if name == "RTL_ALT_M" else find(name)
    assert "no longer there" in scene.restore()
    assert scene.done == {"RTL_ALT_M": "gone"}


def test_another_supervisor_keeps_the_vehicle(tmp_path, monkeypatch):
    scene = Aboard("px4", tmp_path)
    monkeypatch.setattr(type(scene.connection.stations), "supervisor_of", lambda *_: "skyway 200")
    with pytest.raises(CommandRefusedError, match="skyway 200 supervises it"):
        scene.restore()


def test_a_renamed_parameter_is_restored_under_its_new_name_and_unit(tmp_path):
    scene = Aboard("ardupilot", tmp_path, firmware="4.8", text="RTL_ALT,4200\n")
    assert scene.difference.renamed == (("RTL_ALT", "RTL_ALT_M"),)
    (change,) = scene.difference.changes
    assert (change.name, change.then) == ("RTL_ALT_M", 42.0)
    assert scene.restore() == ""


def test_unknown_ones_its_system_id_and_its_counters_are_left(tmp_path):
    text = "MPC_XY_CRUISE,6\nNO_SUCH,1\nMAV_SYS_ID,9\n"
    difference = Aboard("px4", tmp_path, text=text).difference
    assert [change.name for change in difference.changes] == ["MPC_XY_CRUISE"]
    assert difference.absent == ("NO_SUCH",)
    assert difference.left[0][0] == "MAV_SYS_ID"


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("RTL_ALT,1\n", "has none of its 1 parameters"),
        ("# Stack: ArduPilot\nMPC_XY_CRUISE,6\n", "is of another autopilot"),
        ("MPC_XY_CRUISE,6\nMPC_XY_CRUISE,7\n", "stands there twice"),
        ("MAV_SYS_ID,1.5\n", "is a whole number on the vehicle"),
        ("MAV_SYS_ID,1e30\n", "does not fit this parameter"),
        ("MPC_XY_CRUISE,1e300\n", "does not fit this parameter"),
        ("1\t100\tCAM,1\t1\t6\n", "is not a parameter"),
        ("1\t100\tCAM\t1\t6\n", "has no parameters"),
        ("MPC_XY_CRUISE,nan\n", "is not a parameter"),
        ("MPC_XY_CRUISE,inf\n", "is not a parameter"),
        ("MPC_XY_CRUISE,1e39\n", "does not fit this parameter"),
        (
            "MPC_XY_CRUISE,2000\n",
            r"is outside the plausible range .*got '2000'.*; 0 to 60 m/s; correct it, or remove its line",
        ),
        ("", "has no parameters"),
    ],
)
def test_a_set_that_makes_no_sense_is_refused_in_one_line(tmp_path, text, fault):
    has = {name: ParameterValue(name, 5.0, kind) for name, kind in (("MPC_XY_CRUISE", REAL32), ("MAV_SYS_ID", 6))}
    file = tmp_path / "a.param"
    file.write_text(text)
    with pytest.raises(InputError, match=fault) as refused:
        compare_set(read_set(file), has, family_named("px4"))
    assert len(str(refused.value).splitlines()) == 1


def test_an_implausible_value_that_the_vehicle_has_already_does_not_keep_the_others_from_being_restored(tmp_path):
    has = {"MPC_XY_CRUISE": ParameterValue("MPC_XY_CRUISE", 2000.0, REAL32), "FOO": ParameterValue("FOO", 1.0, REAL32)}
    file = tmp_path / "a.param"
    file.write_text("MPC_XY_CRUISE,2000\nFOO,2\n")
    found = compare_set(read_set(file), has, family_named("px4"))
    assert [change.name for change in found.changes] == ["FOO"]


def flown(path, **changed):
    """The journal of a flight that changed parameters, each from one value to another, and did not restore them."""
    start = {"n": 1, "time": "2014-05-13T16:53:20.000Z", "state": "connecting", "event": "start", "flight": 0, "reason": None, "data": {"schema": SCHEMA}}  # fmt: skip
    path.write_text(json.dumps(start) + "\n")
    journal = Journal(path, lambda: 1_400_000_000.0, resume=True)
    for name, (before, after) in changed.items():
        journal.write("preflight", ParameterNote(name=name, done="setting", before=before, after=after))
    journal.close()
    return path


def test_what_a_flight_changed_is_shown_before_it_is_restored_and_asked_for_once(run, tmp_path, monkeypatch):
    path = flown(tmp_path / "f.jsonl", MPC_XY_CRUISE=(6.5, 5.0), RTL_RETURN_ALT=(50.0, 75.0))
    with served(tcp_port=0, autopilot="px4") as there:
        store = there.world.vehicles[1].autopilot.parameters
        own = store["RTL_RETURN_ALT"]
        monkeypatch.setattr("sys.stdin", Terminal("n\n"))
        code, out, _ = run(there, "params", "restore", path)
        assert code == 0
        assert "MPC_XY_CRUISE: 5 (before the flight: 6.5) would be restored\n" in out
        assert "would be left: it was changed since" in out
        assert out.index("would be restored") < out.index("set 1 parameter?") < out.index("nothing was changed")
        assert store["MPC_XY_CRUISE"] == 5.0
        code, out, _ = run(there, "params", "restore", path, "--yes")
        assert code == 0
        shown, done = out.index("would be restored"), out.index("MPC_XY_CRUISE: 6.5 (before the flight: 6.5) restored")
        assert shown < done
        assert (store["MPC_XY_CRUISE"], store["RTL_RETURN_ALT"]) == (6.5, own)


def test_a_journal_with_a_value_that_the_vehicle_cannot_hold_restores_nothing(run, tmp_path):
    with served(tcp_port=0, autopilot="px4") as there:
        store = there.world.vehicles[1].autopilot.parameters
        kind = store["NAV_DLL_ACT"]
        path = flown(tmp_path / "f.jsonl", MPC_XY_CRUISE=(6.5, 5.0), NAV_DLL_ACT=(1.5, kind))
        for words in ([], ["--yes"]):
            code, _, err = run(there, "params", "restore", path, *words)
            assert code == 2
            assert "NAV_DLL_ACT: is a whole number on the vehicle (got '1.5'); nothing was restored" in err
        assert store["MPC_XY_CRUISE"] == 5.0


VALUES = st.dictionaries(
    st.from_regex(r"[A-Z][A-Z0-9_]{0,15}", fullmatch=True),
    st.one_of(
        st.floats(width=32, allow_nan=False, allow_infinity=False).map(lambda value: (value, REAL32)),
        st.integers(-(2**31), 2**31 - 1).map(lambda value: (float(value), 6)),
    ),
    min_size=1,
    max_size=20,
)


@settings(max_examples=30)
@given(VALUES, st.sampled_from([".param", ".params"]))
def test_what_is_saved_is_read_back_to_the_last_bit(tmp_path_factory, values, ending):
    file = tmp_path_factory.mktemp("sets") / f"a{ending}"
    told = [ParameterValue(name, value, kind) for name, (value, kind) in values.items()]
    file.write_text(set_text(file, told, ("a vehicle",), "px4", 1))
    saved = read_set(file)
    assert saved.stack == "px4"
    difference = compare_set(saved, {one.name: one for one in told}, family_named("px4"))
    assert (difference.same, difference.changes) == (len(told), ())
    assert all(math.isclose(saved.values[one.name], one.value, rel_tol=1e-8) for one in told)


@settings(max_examples=30)
@given(VALUES)
def test_pymavlink_reads_what_is_saved(tmp_path_factory, values):
    from pymavlink.mavparm import MAVParmDict

    file = tmp_path_factory.mktemp("sets") / "a.param"
    told = [ParameterValue(name, value, kind) for name, (value, kind) in values.items()]
    file.write_text(set_text(file, told, ("a vehicle",), "ardupilot", 1))
    theirs = MAVParmDict()
    assert theirs.load(str(file), wildcard="*", check=False)
    ours = read_set(file).values
    assert {name: theirs[name] for name in theirs} == ours


@pytest.mark.parametrize(
    "ask",
    [
        lambda craft: craft.parameter("SYSID_THISMAV"),
        lambda craft: craft.parameters(),
        lambda craft: craft.command("begin", 300),
        lambda craft: craft.download(MissionKind.MISSION),
        lambda craft: LogStore(craft, "requests").logs(),
        lambda craft: LogStore(craft, "ftp").logs(),
    ],
)
def test_a_vehicle_that_does_not_answer_is_told_with_the_time_that_all_tries_took(ask, tmp_path):
    scene = Aboard("ardupilot", tmp_path)
    clock = scene.connection.clock
    scene.vehicle.faults.add(parse_fault("link-loss"), scene.vehicle.sim_s)
    begun_s = clock.now_s()
    with pytest.raises(VehicleTimeoutError) as told:
        ask(scene.craft)
    took_s = clock.now_s() - begun_s
    assert took_s > 2.0
    assert told.value.waited_s == pytest.approx(took_s, rel=0.3)
