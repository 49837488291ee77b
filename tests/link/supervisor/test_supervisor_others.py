"""Another ground station, at the same vehicle by a link of its own: what it changes is noticed, shown, and answered as a pilot's doing."""

import dataclasses

import pytest

from benchmarks.link.deliveries import Scripted, Stage, Story
from skyway.link.protocol.connection import Connection
from skyway.link.protocol.mission_words import MissionKind
from skyway.link.supervisor import read_journal
from skyway.link.vehicle.vehicle import Vehicle
from skyway.missions.items.commands import Command
from skyway.missions.items.mission import Mission
from skyway.missions.items.rally import RallyPoints
from skyway.models.base.errors import CommandRefusedError

STORY = Story(start="jersey-city", to="hoboken", soc=0.9, traffic=False, still=True)
NOTICED_S = 2.0


class Other:
    """Another station, which does something once the drone of a delivery is on its way."""

    def __init__(self, stage, deed, system=250):
        self.stage, self.deed, self.done_s = stage, deed, None
        self.connection = Connection(stage.lockstep.connect(stage.craft), stage.lockstep.clock, system=system)
        self.craft = None

    def tick(self, context):
        self.connection.pump(0.0)
        if self.craft is None and self.connection.peers:
            self.craft = Vehicle(self.connection, 1)
        sample = context.observed.sample
        if self.done_s is None and context.state == "flying" and sample is not None and sample.height_m > 40.0:
            self.deed(self.craft)
            self.done_s = self.stage.lockstep.clock.posix_s()


def higher(craft):
    """Raise the last waypoint, and store the mission again, as a person does in a ground station."""
    items = list(craft.download(MissionKind.MISSION).items)
    last = max(number for number, item in enumerate(items) if item.command == Command.NAV_WAYPOINT)
    items[last] = dataclasses.replace(items[last], z=items[last].z + 20.0)
    assert craft.upload(Mission(tuple(items)), current=2).verified


def without_fence(craft):
    craft.clear(MissionKind.FENCE)


def other_rally_point(craft):
    first, *others = craft.download(MissionKind.RALLY).points
    assert craft.upload(RallyPoints((dataclasses.replace(first, altitude_m=first.altitude_m + 20.0), *others))).verified


def return_height(craft):
    craft.set_parameter("RTL_RETURN_ALT" if craft.family.name == "px4" else "RTL_ALT", 77.0)


DEEDS = {
    higher: ("mission", "changed by somebody else: mission"),
    without_fence: ("fence", "changed by somebody else: fence"),
    other_rally_point: ("rally points", "changed by somebody else: rally points"),
    return_height: ("parameter", "to 77"),
}


def beside(tmp_path, deed, **more):
    stage = Stage(dataclasses.replace(STORY, **more), tmp_path)
    stage.operator = Scripted(
        lambda question, _: (5.0, "leave" if "leave" in question else "yes"), lambda: stage.lockstep.now_s
    )
    return stage, Other(stage, deed)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("deed", DEEDS)
def test_what_another_station_changes_in_flight_is_noticed_within_two_seconds_and_shown(deed, autopilot, tmp_path):
    stage, other = beside(tmp_path, deed, autopilot=autopilot)
    outcome = stage.fly(on_tick=other.tick)
    assert outcome.state == "left-to-itself", outcome
    what, shown = DEEDS[deed]
    records = read_journal(stage.journal_path).records
    noticed = [r for r in records if r.event == "change" and r.data["what"].startswith(what) and not r.data["ours"]]
    assert noticed
    assert noticed[0].time_s - other.done_s <= NOTICED_S
    assert any("somebody else changed" in line for line in stage.operator.lines)
    assert any(shown in line for line in stage.operator.lines), stage.operator.lines[-8:]


class Between(Other):
    """The same between two looks of the supervisor, so long after one."""

    def __init__(self, stage, deed, later_s):
        super().__init__(stage, lambda _: None)
        self.later, self.later_s, self.at_s = deed, later_s, None

    def tick(self, context):
        super().tick(context)
        if self.done_s is not None and self.at_s is None:
            self.at_s = self.done_s + self.later_s
            context.vehicle.connection.listeners.append(self.hear)

    def hear(self, *_):
        now_s = self.stage.lockstep.clock.posix_s
        if self.later is not None and now_s() >= self.at_s:
            deed, self.later = self.later, None
            deed(self.craft)
            self.done_s = now_s()


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("deed", [without_fence, other_rally_point])
@pytest.mark.parametrize("later_s", [0.05, 0.35, 0.65, 0.95])
def test_the_moment_at_which_it_is_changed_makes_no_difference(deed, autopilot, later_s, tmp_path):
    stage, _ = beside(tmp_path, deed, autopilot=autopilot)
    other = Between(stage, deed, later_s)
    stage.fly(on_tick=other.tick)
    what = DEEDS[deed][0]
    records = read_journal(stage.journal_path).records
    noticed = [r for r in records if r.event == "change" and r.data["what"].startswith(what) and not r.data["ours"]]
    assert noticed[0].time_s - other.done_s <= NOTICED_S


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_flight_that_nobody_disturbs_notices_nothing(autopilot, tmp_path):
    stage, other = beside(tmp_path, lambda _: None, autopilot=autopilot)
    assert stage.fly(on_tick=other.tick).delivered
    foreign = [r.reason for r in read_journal(stage.journal_path).records if r.event == "change" and not r.data["ours"]]
    assert not [reason for reason in foreign if "mission:" in reason or "fence" in reason or "parameter" in reason]


@pytest.mark.parametrize(
    ("system", "under_way", "goes_on"),
    [
        (254, False, False),
        (250, True, False),
        (254, True, False),
        pytest.param(254, None, True, marks=pytest.mark.slow),
    ],
)
def test_of_two_supervisors_one_stops_before_its_first_order(system, under_way, goes_on, tmp_path):
    """The other one is under way, or begins with us and has the lower id; or it begins when we are on our way (None)."""
    stage, other = beside(tmp_path, lambda _: None)
    other.connection = Connection(other.connection.transport, stage.lockstep.clock, system=system)

    def tick(context):
        if under_way is not None or context.state == "flying":
            other.connection.supervise(1, commanded=bool(under_way))
        other.connection.pump(0.0)

    outcome = stage.fly(on_tick=tick)
    assert outcome.delivered == goes_on
    if not goes_on:
        assert f"another skyway (system {system}" in outcome.reason
        ordered = [event.text for event in stage.world.events if "station 255" in event.text]
        assert ordered == ["ground station 255 heard"]
        with pytest.raises(CommandRefusedError, match="another skyway"):
            stage.supervisor.context.vehicle.check_ground_station()


@pytest.mark.slow
def test_where_the_vehicle_says_who_is_in_control_it_is_asked_for_and_given_back(tmp_path):
    stage, _ = beside(tmp_path, lambda _: None, vehicle={"operator_control": True})
    assert stage.fly().delivered
    said = [event.text for event in stage.world.events if event.text.startswith("in control")]
    assert said == ["in control: station 255", "in control: nobody"]


def test_a_station_that_keeps_control_is_named_and_one_that_is_given_it_in_flight_ends_our_orders(tmp_path):
    stage, other = beside(tmp_path, lambda _: None, vehicle={"operator_control": True})
    stage.craft.commands.control.holder = 250
    outcome = stage.fly(on_tick=other.tick)
    assert outcome.state == "stopped-safe"
    assert "ground station 250 is in control" in outcome.reason

    def takes_over(_):
        stage.craft.commands.control.holder = 250

    (tmp_path / "again").mkdir()
    stage, other = beside(tmp_path / "again", takes_over, vehicle={"operator_control": True})
    outcome = stage.fly(on_tick=other.tick)
    assert outcome.state == "left-to-itself"
    assert any("ground station 250 has taken control" in line for line in stage.operator.lines)
