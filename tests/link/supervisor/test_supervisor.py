"""A delivery is supervised leg by leg on both autopilots; what goes wrong ends in a named safe state."""

import dataclasses
import json
from datetime import datetime
from itertools import pairwise

import pytest
from msgspec.structs import replace
from states_picture import drawn_edges, picture
from supervision_page import PAGE, PICTURE, drawn

from benchmarks.link.deliveries import Scripted, Stage, Story, newyork
from skyway.link.supervisor import State, read_journal
from skyway.link.supervisor.journal.entries import Start, StateEntered
from skyway.link.supervisor.journal.file import Journal
from skyway.link.supervisor.legs import plan_leg
from skyway.link.supervisor.states import ENDS, TABLE, OffTableError, check
from skyway.missions.autopilots.registry import family_named
from skyway.missions.builder.mission_options import MissionOptions
from skyway.missions.items.commands import Command
from skyway.models.base.errors import InputError
from skyway.models.queues.pad_service import PadServiceError
from skyway.sim_stub.faults import parse_fault

SHORT = {"start": "bellevue", "to": "city-hall"}


def told(faults):
    return tuple(parse_fault(text) for text in faults)


def events(stage, kind):
    return [record for record in read_journal(stage.journal_path).records if record.event == kind]


def states(stage):
    return [record.data["after"] for record in events(stage, "state")]


SLOW_ARDUPILOT = ["px4", pytest.param("ardupilot", marks=pytest.mark.slow)]


@pytest.mark.parametrize("autopilot", SLOW_ARDUPILOT)
def test_a_package_is_delivered_with_a_recharge_on_the_way(autopilot, tmp_path):
    stage = Stage(Story(autopilot=autopilot, start="bellevue", to="yankee-stadium", soc=0.42, traffic=False), tmp_path)
    least_hz = {}

    def watch(ctx):
        sent_hz = sum(1.0 / stream.interval_s for stream in stage.craft.radio.ports[0].streams.values())
        least_hz[str(ctx.state)] = min(sent_hz, least_hz.get(str(ctx.state), sent_hz))

    outcome = stage.fly(on_tick=watch)
    assert outcome.delivered, outcome
    assert least_hz["charging"] < 6.0 < min(least_hz["preflight"], least_hz["flying"])
    assert outcome.exit_code == 0
    assert stage.craft.station() == "yankee-stadium"
    assert not stage.craft.autopilot.armed
    assert stage.craft.body.payload_kg == 0.0
    assert stage.craft.battery.soc > 0.15
    passed = states(stage)
    assert "charging" in passed
    assert passed[-1] == "delivered"
    changes = [(one.data["after"], datetime.fromisoformat(one.time)) for one in events(stage, "state")]
    stays = [(b - a).total_seconds() for (state, a), (_, b) in pairwise(changes) if state == "charging"]
    assert max(stays) < 2 * 600.0 + 90.0  # it decides again every ten minutes, but for the last ten
    lists = events(stage, "preflight")
    assert lists
    names = {entry["name"] for entry in lists[-1].data["checks"]}
    assert {"battery", "home", "position", "wind", "parameters", "mission", "diverts", "pads", "link loss"} <= names
    legs = events(stage, "leg")
    assert all(leg.data["diverts"] for leg in legs)
    assert len(events(stage, "landed")) == len(legs) == outcome.flights
    strange = [change.reason for change in events(stage, "change") if not change.data["ours"]]
    assert not strange  # an autopilot that disarms itself after its landing is nobody's intervention


@pytest.mark.slow
def test_what_a_pad_has_charged_is_believed_from_the_take_off_on(tmp_path):
    stage = Stage(Story(autopilot="ardupilot", soc=0.22, traffic=False, **SHORT), tmp_path)
    assert stage.fly().delivered
    legs = events(stage, "leg")
    assert legs
    for leg in legs:
        charged = [one for one in events(stage, "battery") if one.n < leg.n][-1]
        assert leg.data["told_soc"] == pytest.approx(charged.data["soc"], abs=0.02)


def test_the_table_of_states_is_never_left_and_is_what_the_page_shows():
    for state, rule in TABLE.items():
        for other in State:
            if other in rule.following:
                check(state, other)
            else:
                with pytest.raises(OffTableError):
                    check(state, other)
        assert rule.overdue is None or rule.overdue in rule.following
    assert {State.DELIVERED, State.STOPPED, State.LEFT} <= ENDS
    reached, wave = {State.CONNECTING}, {State.CONNECTING}
    while wave:
        wave = {after for state in wave for after in TABLE[state].following} - reached
        reached |= wave
    assert reached == set(State)
    assert drawn(PAGE.read_text()) == PAGE.read_text(), "run: python tests/link/supervision_page.py"
    assert picture() == PICTURE.read_text(), "run: python tests/link/supervision_page.py"
    assert drawn_edges() == {(state, after) for state, rule in TABLE.items() for after in rule.following}


@pytest.mark.parametrize(
    ("start", "to"), [("livingston", "newark"), ("newark", "livingston"), ("syosset", "valley-stream")]
)
def test_a_leg_is_flown_above_the_higher_of_its_ends_from_its_beginning_to_above_its_end(start, to, tmp_path):
    stage = Stage(Story(start=start, to=to), tmp_path)
    plan, scenario = stage.composition, newyork()
    service = plan.services[0]
    leg = plan_leg(plan, service, family_named("ardupilot"), MissionOptions(), last=True)
    ground = {
        name: scenario.network.stations[scenario.network.index[name]].elevation_m
        for name in (start, service.destination)
    }
    highest = max(ground.values()) + scenario.rules.cruise_height_m
    way = [item for item in leg.document.mission.items if item.command == Command.NAV_WAYPOINT]
    lands = next(item for item in leg.document.mission.items if item.command == Command.NAV_LAND)
    if not service.via:
        assert way[-1].z + ground[start] == pytest.approx(highest, abs=0.1)
    assert lands.z + ground[start] == pytest.approx(ground[service.destination], abs=0.1)


class NoAnswer:
    """Pads that nobody hears of."""

    def status(self, station):
        raise PadServiceError(f"the pad service of {station} does not answer")

    charge = release = lambda self, station, *_: self.status(station)


def test_pads_that_could_be_known_and_are_not_stop_it_with_the_reason(tmp_path):
    stage = Stage(Story(autopilot="px4", **SHORT), tmp_path)
    stage.pads = NoAnswer()
    outcome = stage.fly()
    assert outcome.state == "stopped-safe"
    assert "pads: UNKNOWN" in outcome.reason
    assert "does not answer" in outcome.reason
    assert outcome.flights == 0
    assert stage.lockstep.now_s < TABLE[State.PREFLIGHT].longest_s


def test_a_pilot_who_takes_over_is_not_commanded_until_the_operator_says_go(tmp_path):
    stage = Stage(Story(autopilot="px4", faults=told(["pilot@90s"]), **SHORT), tmp_path)
    stage.operator = Scripted(lambda q, _: (60.0, "go") if "sending no commands" in q else (0.0, "yes"),
                              stage.lockstep.clock.now_s)  # fmt: skip
    outcome = stage.fly()
    assert outcome.delivered, outcome
    taken = next(event for event in stage.world.events if "(the pilot)" in event.text)
    ours = [event for event in stage.world.events if "station 255" in event.text and event.sim_s > taken.sim_s]
    assert min(event.sim_s for event in ours) >= taken.sim_s + 55.0
    holding = next(record for record in events(stage, "state") if record.data["after"] == "holding")
    assert "somebody else switched" in holding.reason


def test_without_an_operator_a_vehicle_that_a_pilot_has_landed_is_left_standing(tmp_path):
    stage = Stage(Story(autopilot="ardupilot", faults=told(["pilot=land@90s"]), **SHORT), tmp_path)
    outcome = stage.fly()
    assert not outcome.delivered
    assert outcome.state == "landed-elsewhere"
    assert stage.craft.body.grounded
    assert not stage.craft.autopilot.crashed


@pytest.mark.parametrize("autopilot", SLOW_ARDUPILOT)
def test_a_lost_link_needs_nothing_and_the_vehicle_is_picked_up_again(autopilot, tmp_path):
    stage = Stage(Story(autopilot=autopilot, faults=told(["link-loss@100s+60s"]), **SHORT), tmp_path)
    outcome = stage.fly()
    assert outcome.delivered, outcome
    assert "lost-link" in states(stage)


@pytest.mark.slow
def test_a_battery_that_drops_makes_it_divert_with_the_reason(tmp_path):
    story = Story(start="bellevue", to="yankee-stadium", soc=1.0, faults=told(["battery-drop=0.6@150s"]))
    stage = Stage(story, tmp_path)
    outcome = stage.fly()
    assert outcome.state in ("delivered", "stopped-safe"), outcome
    turned = [record for record in events(stage, "decision") if record.data["action"] == "divert"]
    assert turned
    assert "below the reserve with probability" in turned[0].reason
    assert turned[0].data["divert_soc"] > turned[0].data["soc_land"]
    assert not stage.craft.autopilot.crashed
    back = [one for one in events(stage, "track") if one.state == "diverting"]
    about = [one.data for one in back if one.time_s > back[0].time_s + 25.0]  # it has turned about
    top_m = max(one["height_m"] for one in about)
    level = [one for one in about if one["height_m"] > top_m - 1.0]  # no climb, no descent
    slower = [one["commanded_mps"] - one["ground_speed_mps"] for one in level[:-3]]  # nor braking
    assert len(slower) > 9
    assert all(abs(mps) < 2.5 for mps in slower), slower  # it flies as fast as it was told, not as on the way there


def test_a_take_off_is_not_begun_without_a_word_where_one_is_asked_for(tmp_path):
    stage = Stage(Story(**SHORT), tmp_path)
    stage.operator = Scripted(lambda _q, _n: (5.0, "no"), stage.lockstep.clock.now_s)
    outcome = stage.fly()
    assert outcome.state == "stopped-safe"
    assert "said no to the take-off" in outcome.reason
    assert outcome.reason.endswith("is still on board, and is flown if the drone is armed and started: skyway clear --kind all --yes removes it")  # fmt: skip
    assert not [line for line in stage.operator.lines if line.startswith("stopped-safe")], (
        "the command says it at its end"
    )
    assert outcome.exit_code == 1
    assert not any("armed (" in event.text for event in stage.world.events)


@pytest.mark.slow
def test_ctrl_c_stays_at_the_next_landing_and_twice_leaves_it_saying_what_it_will_do(tmp_path):
    stage = Stage(Story(start="bellevue", to="white-plains"), tmp_path)
    stage.operator = Scripted(lambda _q, _n: (0.0, "yes"), stage.lockstep.clock.now_s)

    def press(ctx):
        stage.operator.interrupts = 1 if ctx.in_air else 0

    outcome = stage.fly(on_tick=press)
    assert outcome.state == "stopped-safe"
    assert outcome.station == "yankee-stadium"
    assert any(
        "Ctrl-C again ends the program now" in line and "finishes its mission" in line for line in stage.operator.lines
    )


def test_left_in_the_air_it_finishes_its_leg_by_its_own_parameters(tmp_path):
    stage = Stage(Story(**SHORT), tmp_path)

    def press(ctx):
        ctx.operator.interrupts = (ctx.delivery.flight and ctx.in_air) * (1 + (ctx.operator.interrupts > 0))

    outcome = stage.fly(on_tick=press)
    assert outcome.state == "left-to-itself"
    assert "finishes its mission, lands and disarms there (COM_DLL_EXCEPT)" in outcome.reason
    stage.lockstep.run_for(600.0)
    assert stage.craft.station() == "city-hall"
    assert not stage.craft.autopilot.armed


def test_what_a_vehicle_does_alone_is_told_from_its_parameters():
    px4, ardupilot = (family_named(name).failsafes for name in ("px4", "ardupilot"))
    exceptions, action = "data-link-exceptions", "data-link-action"
    assert px4.finishes_alone({exceptions: 1.0}) is True
    assert px4.finishes_alone({exceptions: 2.0}) is False
    assert px4.finishes_alone({action: 0.0}) is True, "1.15 has no exceptions"
    assert px4.finishes_alone({}) is None
    enabled, options = "ground-station-failsafe", "failsafe-options"
    assert ardupilot.finishes_alone({enabled: 1.0, options: 2.0}) is True
    assert ardupilot.finishes_alone({enabled: 1.0, options: 16.0}) is False
    said = px4.when_left({exceptions: 0.0, action: 2.0, "data-link-timeout": 10.0, "critical-battery": 0.07})
    assert "after 10 s without skyway it returns" in said
    assert "7 %" in said
    assert "returns" in ardupilot.when_left({enabled: 1.0, options: 0.0, "battery-capacity": 15000.0})


def test_a_torn_line_at_the_end_of_a_journal_is_left_out_and_cut_off(tmp_path):
    path = tmp_path / "j.jsonl"
    book = Journal(path, lambda: 1.0e9)
    begin = Start.read({"schema": "skyway.journal/1"})
    book.write("connecting", replace(begin, payload_kg=float("nan")), "begun")
    book.write("connecting", StateEntered(before="connecting", after="replanning"), "next")
    book.close()
    whole = path.read_bytes()
    path.write_bytes(whole + b'{"n":3,"time":"20')
    found = read_journal(path)
    assert [record.n for record in found.records] == [1, 2]
    assert found.records[0].data["payload_kg"] is None
    book = Journal(path, lambda: 1.0e9, resume=True)
    book.write("connecting", StateEntered(before="connecting", after="replanning"), "again")
    book.close()
    assert [json.loads(line)["n"] for line in path.read_text().splitlines()] == [1, 2, 3]
    path.write_bytes(whole.replace(b'"n":1', b'"n":x'))
    with pytest.raises(InputError, match="not a record of a journal"):
        read_journal(path)
    with pytest.raises(InputError, match="already exists"):
        Journal(path, lambda: 1.0e9)


@pytest.mark.slow
def test_somebody_else_who_arms_it_on_the_pad_stops_all_commanding(tmp_path):
    stage = Stage(Story(start="bellevue", to="yankee-stadium", soc=0.3, traffic=False), tmp_path)
    done = []

    def meddle(ctx):
        if ctx.state is State.CHARGING and not done:
            done.append(ctx.now_s)
            stage.craft.autopilot.arm(force=True, by="somebody else")

    outcome = stage.fly(on_tick=meddle)
    assert "holding" in states(stage)
    assert not outcome.delivered
    assert outcome.state == "stopped-safe"
    assert stage.craft.station() == "bellevue"
    held = next(record for record in events(stage, "state") if record.data["after"] == "holding")
    assert "somebody else armed" in held.reason


class Downhill(Story):
    """Columbia stands 90 m above the sea: past the next station, at 10 m, a leg to one at 16 m leads below where it took off."""

    def scenario(self):
        plain = newyork()
        stations = [
            dataclasses.replace(one, elevation_m=90.0) if one.id == "columbia" else one
            for one in plain.network.stations
        ]
        return dataclasses.replace(plain, network=dataclasses.replace(plain.network, stations=tuple(stations)))


def test_on_a_leg_that_leads_downhill_it_still_decides_below_its_take_off(tmp_path):
    story = Downhill(start="columbia", to="jacobi", traffic=False, still=True, faults=told(["battery-drop=0.5@300s"]))
    stage = Stage(story, tmp_path)
    outcome = stage.fly()
    assert events(stage, "leg")[0].data["via"] == ["yankee-stadium"]
    turned = [one for one in events(stage, "decision") if one.data["action"] == "divert"]
    assert turned, outcome
    flown = [one for one in events(stage, "track") if one.time < turned[0].time]
    assert flown[-1].data["height_m"] < 0.0  # above its take-off
    assert outcome.state in ("delivered", "stopped-safe"), outcome
