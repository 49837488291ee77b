"""What an operator is told and asked before a take-off, and what of the vehicle is put back afterwards."""

import itertools
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from wires import Meddler, changed_frame

from benchmarks.link.deliveries import Scripted, Stage, Story, newyork
from skyway.link.supervisor import NobodyThere, read_journal
from skyway.link.supervisor.departure.ground import MAX_ASKED, information
from skyway.link.supervisor.departure.parameter_changes import changes_of
from skyway.link.supervisor.observed.vehicle_texts import TextLog
from skyway.missions.autopilots.registry import family_named
from skyway.models.base.geodesy import distance_m
from skyway.models.base.units import from_posix, iso
from skyway.sim_stub.faults import parse_fault

SHORT = {"start": "jersey-city", "to": "hoboken"}
"""The shortest delivery that there is."""
COUNTERS = ("STAT_", "LND_FLIGHT_T", "COM_FLIGHT_UUID", "MIS_TOTAL", "FENCE_TOTAL", "RALLY_TOTAL")
"""What an autopilot counts in parameters by itself."""
BOTH = ["px4", pytest.param("ardupilot", marks=pytest.mark.slow)]


def held(stage):
    """Every parameter of the simulated vehicle, read from the simulator itself."""
    store = stage.craft.autopilot.parameters
    return {one.name: one.value for one in map(store.at, range(len(store))) if not one.name.startswith(COUNTERS)}


def answering(stage, answer):
    stage.operator = Scripted(lambda _q, _n: (2.0, answer), stage.lockstep.clock.now_s)
    return stage.operator


def events(stage, kind):
    return [record for record in read_journal(stage.journal_path).records if record.event == kind]


@pytest.mark.parametrize("autopilot", BOTH)
def test_a_dispatched_drone_that_stood_for_a_while_takes_off_with_what_its_leg_needs(autopilot, tmp_path):
    """It stood in preflight for ever: the plan said 90 %, standing had taken 6 % of it, and the leg needs much less."""
    stage = Stage(
        Story(autopilot=autopilot, soc=0.9, standing_soc=0.84, dispatched=True, still=True, **SHORT), tmp_path
    )
    assert stage.composition.services[0].soc_depart == pytest.approx(0.9)
    assert stage.fly().delivered
    (battery,) = {one.data["said"] for one in events(stage, "check") if one.data["name"] == "battery"}
    have, wanted = (float(one.split(" %")[0]) for one in battery.split(", ")[:2])
    assert wanted < have < 85.0


@pytest.mark.parametrize("autopilot", BOTH)
def test_a_vehicle_has_its_own_parameters_again_after_a_delivery(autopilot, tmp_path):
    stage = Stage(Story(autopilot=autopilot, **SHORT), tmp_path)
    before = held(stage)
    operator = answering(stage, "yes")
    changed, ticks = {}, itertools.count()

    def look(ctx):
        if ctx.in_air and next(ticks) % 20 == 0:
            changed.update({name: value for name, value in held(stage).items() if value != before[name]})

    outcome = stage.fly(on_tick=look)
    assert outcome.delivered, outcome
    assert changed, "nothing was set: the test proves nothing"
    assert held(stage) == before
    told = "\n".join(operator.lines)
    for name, value in changed.items():
        assert f"{name} {before[name]:g} > {value:g}" in told
    assert told.index("to set on the drone") < told.index("yes or no?")
    records = read_journal(stage.journal_path).records
    for name in changed:
        done = [r.data["done"] for r in records if r.event == "parameter" and r.data.get("name") == name]
        assert done == ["setting", "set", "restored"]
    for number, record in enumerate(records):  # killed anywhere, the journal knows the old value of what may be changed
        if record.event != "parameter":
            continue
        left = changes_of(records[: number + 1]).before
        assert all(math.isclose(value, before[name]) for name, value in left.items())
    assert not changes_of(records).before


@pytest.mark.parametrize("autopilot", BOTH)
def test_no_leaves_every_parameter_as_it_was(autopilot, tmp_path):
    stage = Stage(Story(autopilot=autopilot, **SHORT), tmp_path)
    before = held(stage)
    answering(stage, "no")
    outcome = stage.fly()
    assert outcome.state == "stopped-safe"
    assert held(stage) == before
    assert not events(stage, "parameter")


def test_a_question_that_comes_again_after_a_late_yes_is_explained(tmp_path):
    stage = Stage(Story(still=True, **SHORT), tmp_path)
    asked = itertools.count()
    stage.operator = Scripted(lambda _q, _n: (2.0 if next(asked) else 3600.0, "yes"), stage.lockstep.clock.now_s)
    assert stage.fly().delivered
    lines = stage.operator.lines
    first, again = (n for n, line in enumerate(lines) if "yes or no?" in line)
    (why,) = (
        n for n, line in enumerate(lines) if re.search(r"the charge fell from \d+ % to \d+ % while waiting", line)
    )
    assert first < why < again
    said = {one.data["said"] for one in events(stage, "check") if one.data["name"] == "mission"}
    assert said
    assert all(re.fullmatch(r"\d+ items, 1 fence area, (1 rally point|\d+ rally points)", one) for one in said)
    assert not any("1 rally points" in one for one in said)


def test_what_was_set_is_put_back_by_a_resume_after_a_crash(tmp_path):
    stage = Stage(Story(**SHORT), tmp_path)
    before = held(stage)

    class Killed(BaseException):
        pass

    def kill(ctx):
        if ctx.in_air:
            raise Killed

    with pytest.raises(Killed):
        stage.fly(on_tick=kill)
    stage.supervisor.context.vehicle.connection.close()
    assert held(stage) != before
    left = changes_of(read_journal(stage.journal_path).records)
    assert left.before == {name: before[name] for name, value in held(stage).items() if value != before[name]}
    outcome = stage.fly(resume=True)
    assert outcome.delivered, outcome
    assert held(stage) == before
    assert not changes_of(read_journal(stage.journal_path).records).before


def test_the_battery_check_says_what_the_charge_is_for_and_how_exactly_it_is_reported(tmp_path):
    """It said "ok: 95 %, 96 % needed", and 59 % for a leg that takes 18 %, without a word more."""
    stage = Stage(Story(**SHORT), tmp_path)
    answering(stage, "yes")
    said = []

    def short(ctx):
        if ctx.delivery.least_soc is not None and ctx.delivery.flight == 0:
            ctx.delivery.least_soc = ctx.battery.soc + 0.01

    assert stage.fly(on_tick=short).delivered
    said = [one.data["said"] for one in events(stage, "check") if one.data["name"] == "battery"]
    assert all("needed: the flight to" in one and "the reserve of 20 %, and a divert station" in one for one in said)
    assert any("less by up to 1.5 points is enough: the charge is reported in whole percent" in one for one in said)


@pytest.mark.parametrize("later_s", [0.0, 7200.0])
def test_a_resume_says_that_the_clock_is_before_the_end_of_the_journal(later_s, tmp_path):
    stage = Stage(Story(**SHORT), tmp_path)
    answering(stage, "no")
    stage.fly()
    last = read_journal(stage.journal_path).records[-1]
    later = iso(from_posix(last.time_s + later_s))
    text = stage.journal_path.read_text()
    head, _, tail = text.rpartition(last.time)
    stage.journal_path.write_text(f"{head}{later}{tail}")
    operator = answering(stage, "no")
    stage.supervisor.context.vehicle.connection.close()
    stage.board(resume=True).context.journal.close()
    told = [line for line in operator.lines if "before the end of the journal" in line]
    assert [line.partition(",")[0] for line in told] == (
        ["the clock is 2 h before the end of the journal"] if later_s else []
    )


def test_a_parameter_that_somebody_else_changed_meanwhile_is_left_and_that_is_said(tmp_path):
    stage = Stage(Story(**SHORT), tmp_path)
    lines = []
    stage.operator = NobodyThere(show=lines.append)

    def other(ctx):
        if ctx.in_air:
            stage.craft.autopilot.parameters.set("MPC_XY_CRUISE", 7.0)

    assert stage.fly(on_tick=other).delivered
    assert held(stage)["MPC_XY_CRUISE"] == 7.0
    assert any("MPC_XY_CRUISE is 7, set by somebody else" in line for line in lines)


def test_left_in_the_air_it_keeps_its_failsafes_and_the_way_back_is_told(tmp_path):
    stage = Stage(Story(**SHORT), tmp_path)
    lines = []
    stage.operator = NobodyThere(show=lines.append)

    def press(ctx):
        ctx.operator.interrupts = (ctx.delivery.flight and ctx.in_air) * (1 + (ctx.operator.interrupts > 0))

    assert stage.fly(on_tick=press).state == "left-to-itself"
    assert held(stage)["COM_DLL_EXCEPT"] == 1.0
    assert any("not restored" in line and "skyway params restore" in line for line in lines)


def test_a_wrong_home_height_is_told_while_it_is_waited_for(tmp_path):
    stage = Stage(Story(supervised=False, **SHORT), tmp_path)
    places = dict(stage.composition.stations)
    places[SHORT["start"]] = replace(places[SHORT["start"]], elevation_m=450.0)
    stage.composition = replace(stage.composition, stations=places)
    outcome = stage.fly()
    assert outcome.state == "stopped-safe"
    assert "above sea level, but" in outcome.reason
    records = read_journal(stage.journal_path).records
    entry = next(r for r in records if r.event == "check" and r.data["name"] == "home")
    assert entry.data["verdict"] == "no"
    assert f"{SHORT['start']} is at 450 m" in entry.data["said"]
    waits = [r for r in records if r.event == "waits"]
    assert len(waits) >= 2  # and again while it goes on
    assert "home" in waits[0].reason
    assert entry.time_s < records[-1].time_s - 60.0  # at once, not at the end


def test_what_is_waited_for_at_the_beginning_is_told_at_once(tmp_path):
    stage = Stage(Story(supervised=False, faults=(parse_fault("soc-unknown"),), **SHORT), tmp_path)
    operator = answering(stage, "yes")
    begun_s = stage.lockstep.clock.now_s()
    first_s = []

    def look(ctx):
        if not first_s and any("waiting for up to 45 s" in line for line in operator.lines):
            first_s.append(stage.lockstep.clock.now_s() - begun_s)

    outcome = stage.fly(on_tick=look)
    assert outcome.state == "stopped-safe"
    assert "does not report its state of charge" in outcome.reason
    assert [
        line
        for line in operator.lines
        if "waiting for up to 45 s: the drone does not report its state of charge" in line
    ]
    assert first_s[0] < 15.0


def test_a_second_battery_that_is_nearly_empty_keeps_the_drone_on_the_ground(tmp_path):
    def spoil(number, message, frame, up):
        told = not up and message is not None and message.name == "BATTERY_STATUS"
        return frame + changed_frame(message, id=1, battery_remaining=5) if told else frame

    stage = Stage(Story(supervised=False, **SHORT), tmp_path)
    connect = stage.lockstep.connect
    stage.lockstep.connect = lambda *given, **named: Meddler(connect(*given, **named), spoil)
    outcome = stage.fly()
    assert outcome.state == "stopped-safe"
    assert re.search(r"battery 1 reports 5 %, \d+ % needed: charge or replace it", outcome.reason), outcome


def test_a_vehicle_that_is_no_multirotor_does_not_take_off(tmp_path):
    def spoil(number, message, frame, up):
        beats = not up and message is not None and message.name == "HEARTBEAT"
        return changed_frame(message, type=22) if beats else frame

    stage = Stage(Story(supervised=False, **SHORT), tmp_path)
    connect = stage.lockstep.connect
    stage.lockstep.connect = lambda *given, **named: Meddler(connect(*given, **named), spoil)
    outcome = stage.fly()
    assert outcome.state == "stopped-safe"
    assert "VTOL: skyway flies multirotors only" in outcome.reason


@pytest.mark.parametrize("number", [0, 16], ids=["generic", "flapping wings"])
@pytest.mark.parametrize(("given", "state"), [(None, "stopped-safe"), ("multirotor", "delivered")])
def test_a_vehicle_that_does_not_say_what_it_is_takes_off_only_where_a_person_says_it(number, given, state, tmp_path):
    def spoil(_number, message, frame, up):
        beats = not up and message is not None and message.name == "HEARTBEAT"
        return changed_frame(message, type=number) if beats else frame

    stage = Stage(Story(supervised=False, **SHORT), tmp_path)
    connect, job = stage.lockstep.connect, stage.job
    stage.lockstep.connect = lambda *given, **named: Meddler(connect(*given, **named), spoil)
    stage.job = lambda: replace(job(), vehicle_kind=given)
    outcome = stage.fly()
    assert outcome.state == state, outcome
    if given is None:
        assert "does not report what kind of vehicle it is: set its parameter MAV_TYPE, or say" in outcome.reason
        assert "--vehicle multirotor" in outcome.reason
    else:
        (said,) = {one.data["said"] for one in events(stage, "check") if one.data["name"] == "vehicle"}
        assert said.endswith(f"type {number}: a multirotor, as given by --vehicle")


def test_a_kind_that_a_person_gives_does_not_stand_against_the_vehicles_own(tmp_path):
    def spoil(_number, message, frame, up):
        beats = not up and message is not None and message.name == "HEARTBEAT"
        return changed_frame(message, type=1) if beats else frame

    stage = Stage(Story(supervised=False, **SHORT), tmp_path)
    connect, job = stage.lockstep.connect, stage.job
    stage.lockstep.connect = lambda *given, **named: Meddler(connect(*given, **named), spoil)
    stage.job = lambda: replace(job(), vehicle_kind="multirotor")
    outcome = stage.fly()
    assert "plane: skyway flies multirotors only" in outcome.reason


@pytest.mark.parametrize("autopilot", BOTH)
def test_what_the_autopilot_refuses_is_told_once_with_its_count(autopilot, tmp_path):
    stage = Stage(Story(autopilot=autopilot, faults=(parse_fault("prearm@0s+60s"),), **SHORT), tmp_path)
    lines = []
    stage.operator = NobodyThere(show=lines.append)
    outcome = stage.fly()
    assert outcome.delivered, outcome
    said = [line for line in lines if line.startswith("the drone reports: ")]
    refused = sum("arming refused" in event.text for event in stage.world.events)
    assert refused > 10
    assert 1 <= len(said) <= 4, lines
    assert all("Compass not healthy" in line for line in said)
    assert said[-1].endswith("times)")


def test_a_text_that_is_repeated_is_told_with_its_count_and_ever_more_seldom():
    log = TextLog()
    told = []
    for second in range(228):
        told += [str(said) for said in log.hear([(2, "Preflight Fail: GPS 1: Bad fix")], float(second))]
    assert told[0] == "Preflight Fail: GPS 1: Bad fix"
    assert len(told) <= 5
    assert "times)" in told[-1]
    assert log.latest.count == 228
    assert [str(s) for s in log.hear([(2, "PreArm: Battery below 10.5"), (2, "PreArm: Battery below 10.4")], 500.0)] == [
        "Preflight Fail: GPS 1: Bad fix (228 times)", "PreArm: Battery below 10.4 (2 times)",
    ]  # fmt: skip
    log.hear([(4, "GPS 1: x"), (4, "GPS 2: x")], 510.0)
    assert log.latest.count == 1  # whole numbers tell things apart


def test_ctrl_c_on_the_ground_ends_it_there_and_puts_the_parameters_back(tmp_path):
    stage = Stage(Story(**SHORT), tmp_path)
    before = held(stage)
    stage.operator = Scripted(lambda _q, _n: None, stage.lockstep.clock.now_s)

    def press(ctx):
        stage.operator.interrupts = int(ctx.conversation.question is not None)

    outcome = stage.fly(on_tick=press)
    assert outcome.state == "stopped-safe"
    assert "Ctrl-C" in outcome.reason
    assert held(stage) == before
    assert stage.lockstep.now_s < 120.0


def test_an_operator_who_goes_away_while_asked_ends_it_and_is_not_waited_for(tmp_path):
    stage = Stage(Story(**SHORT), tmp_path)
    stage.operator = Scripted(lambda _q, _n: None, stage.lockstep.clock.now_s)

    def leave(ctx):
        stage.operator.present = ctx.conversation.question is None

    outcome = stage.fly(on_tick=leave)
    assert outcome.state == "stopped-safe"
    assert "nobody can answer the question any more" in outcome.reason
    assert stage.lockstep.now_s < 120.0


def test_everything_that_a_yes_answers_to_is_told_before_it_is_asked(tmp_path):
    stage = Stage(Story(**SHORT), tmp_path)
    operator = answering(stage, "no")
    stage.fly()
    before = "\n".join(operator.lines).split("yes or no?")[0]
    for word in ("leg 1 of 1: jersey-city > hoboken", "wind", "divert stations on the way", "link to skyway lost", "battery low",
                 "remote control lost", "95 % by", "EDT"):  # fmt: skip
        assert word in before, word


@pytest.mark.parametrize(
    ("family", "values", "words"),
    [
        ("px4", {"COM_DLL_EXCEPT": 1, "COM_RCL_EXCEPT": 1, "COM_LOW_BAT_ACT": 3, "BAT_LOW_THR": 0.15, "BAT_CRIT_THR": 0.07,
                 "BAT_EMERGEN_THR": 0.05},
         ["finishes its mission", "continues its mission", "low (15 %): it only warns", "critical (7 %): it returns",
          "emergency (5 %): it lands"]),
        ("px4", {"NAV_DLL_ACT": 2, "COM_DLL_EXCEPT": 0, "COM_DL_LOSS_T": 10}, ["after 10 s without skyway it returns",
         "remote control lost: unknown", "BAT_CRIT_THR, not read"]),
        ("ardupilot", {"FS_GCS_ENABLE": 1, "FS_OPTIONS": 0, "FS_GCS_TIMEOUT": 5, "FS_THR_ENABLE": 1, "BATT_CAPACITY": 10000,
                       "BATT_LOW_MAH": 2000, "BATT_LOW_VOLT": 21, "BATT_FS_LOW_ACT": 2, "BATT_CRT_MAH": 0,
                       "BATT_CRT_VOLT": 0, "BATT_FS_CRT_ACT": 1},
         ["after 5 s without skyway it returns", "remote control lost: it returns", "low (20 % or 21 V): it returns",
          "critical: no threshold is set"]),
        ("ardupilot", {}, ["is unknown"]),
    ],
)  # fmt: skip
def test_failsafes_are_told_in_words_and_what_was_not_told_is_unknown(family, values, words):
    autopilot = family_named(family)
    said = "\n".join(autopilot.failsafes.by_itself(autopilot.settings.in_our_units(values)))
    for word in words:
        assert word in said, said


def test_the_wind_before_a_take_off_is_the_forecast_of_the_leg_and_is_called_so(tmp_path):
    stage = Stage(Story(**SHORT), tmp_path)
    operator = answering(stage, "no")
    stage.fly()
    said = next(line for line in operator.lines if line.startswith("wind on the way: "))
    assert said.endswith("(forecast)")
    rules, service = newyork().rules, stage.composition.services[0]
    ends = [stage.composition.stations[name] for name in (service.origin, service.destination)]
    ensemble, slot = stage.forecast.at_height(rules.cruise_height_m, rules.wind_profile_exponent), None
    speeds = []
    for place in ends:  # an oracle without the function: speeds at both ends, member by member
        slot = ensemble.slot_at(service.depart.timestamp())
        speeds.append(np.hypot(*ensemble.wind_at(place.lat, place.lon, slot)))
    mean = float(ensemble.probability @ np.mean(speeds, axis=0))
    told = events(stage, "briefing")[0].data["wind"]
    assert told["mean_mps"] == pytest.approx(mean, rel=0.03)
    assert f"wind on the way: {mean:.0f} (" in said
    assert told["p10_mps"] < mean < told["p90_mps"]
    check = next(r for r in events(stage, "check") if r.data["name"] == "wind")
    assert "measured" not in check.data["said"]
    assert check.data["said"].split(" (forecast)")[0] == said.removeprefix("wind on the way: ").split(" (forecast)")[0]


class Counted:
    """Pads that count what they are asked."""

    def __init__(self, pads):
        self.pads, self.asked = pads, []

    def status(self, station):
        self.asked.append(station)
        return self.pads.status(station)


@pytest.mark.parametrize("apart_deg", [0.0005, 0.02])
def test_pads_of_stations_that_no_decision_can_use_are_not_asked_for(apart_deg, tmp_path):
    stage = Stage(Story(**SHORT), tmp_path)
    ctx, scenario = stage.board().context, newyork()
    network, start = scenario.network, SHORT["start"]
    more = [replace(network.stations[0], id=f"far-{k}", lat=40.9 + apart_deg * k) for k in range(1000)]
    many = replace(scenario, network=replace(network, stations=(*network.stations, *more)))
    pads = Counted(stage.pads)
    ctx = replace(ctx, job=replace(ctx.job, scenario=many), pads=pads)
    ctx.delivery.take_plan(stage.composition)
    ctx.delivery.stand_at(start)
    ctx.battery.measured(1.0)
    known = information(ctx)
    near = {one.id for one in network.stations if distance_m(one.lat, one.lon, *place_of(network, start)) < 10_000.0}
    assert len(pads.asked) == len(set(pads.asked)) <= MAX_ASKED + 1 + len(stage.composition.services)
    assert near | {start, *(one.destination for one in stage.composition.services)} <= set(known.busy_pads)
    ctx.journal.close()


def place_of(network, name):
    station = network.stations[network.index[name]]
    return station.lat, station.lon
