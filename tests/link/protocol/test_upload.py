"""'Upload complete' is true, always: on bad radios, through cuts, reboots, rivals and wrong answers."""

import itertools
import re
from dataclasses import replace

import pytest
from wires import FAMILIES, Meddler, Scene, a_mission, as_stored, bad_radio, changed_frame, waypoint

from skyway.link.protocol.connection import Connection
from skyway.link.protocol.exchange import Target
from skyway.link.protocol.mission_words import MissionKind, in_words
from skyway.link.protocol.upload import Upload, UploadEnd
from skyway.link.protocol.verified import UploadJob, UploadState, upload_verified
from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire.frames import FrameWriter
from skyway.link.wire.messages import kinds
from skyway.missions.autopilots.registry import family_named
from skyway.missions.items.commands import Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.geofence import FenceCircle, FencePolygon, Geofence
from skyway.missions.items.mission import Mission, MissionItem
from skyway.missions.items.rally import RallyPoint, RallyPoints
from skyway.models.base.errors import UploadMismatchError
from skyway.sim_stub.faults import Fault

OLD = a_mission(5, height=90.0)
NEW = a_mission(6, height=40.0)


def truthful(scene, outcome, sent, before):
    """Whether what is said about the vehicle is so."""
    holds = scene.stored()
    if outcome.state is UploadState.VERIFIED:
        return holds == as_stored(sent)
    if outcome.state in (UploadState.REFUSED, UploadState.ROLLED_BACK):
        return holds == before
    if scene.family == "px4":
        whole = [] if "not all was sent" in outcome.holds else [as_stored(sent)]
        return holds in (before, *whole)
    new, old = as_stored(sent), before[: len(sent)]
    told = re.search(r"up to (\d+) new items", outcome.holds)
    if told is not None:
        return any(holds == [*new[:n], *old[n:]] for n in range(int(told[1]) + 1)) or holds == before
    return any(holds == [*new[:n], *old[n:]] for n in range(len(new) + 1)) or holds == before


def with_old(family, **how):
    """A scene whose vehicle holds the old mission already."""
    scene = Scene(family, **how)
    assert scene.upload(OLD).verified
    scene.link.count, scene.link.log = 0, []
    return scene


def many(family, items, loss, seeds):
    mission, verified = a_mission(items), 0
    for seed in seeds:
        scene = Scene(family, impairment=bad_radio(loss), seed=seed)
        scene.meet()
        scene.quiet()
        outcome = scene.upload(mission)
        assert truthful(scene, outcome, mission, []), outcome
        verified += outcome.verified
    return verified / len(seeds)


@pytest.mark.parametrize("loss", [0.0, 0.05, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("family", FAMILIES)
def test_uploads_of_twenty_items_are_verified_however_bad_the_radio(family, loss):
    assert many(family, 20, loss, range(1, 31)) == 1.0


@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize("family", FAMILIES)
def test_two_hundred_items_arrive_on_a_bad_radio(family, loss):
    assert many(family, 200, loss, range(1, 6)) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("loss", [0.0, 0.05, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("items", [20, 200])
def test_of_two_hundred_uploads_none_is_silently_different(family, loss, items):
    assert many(family, items, loss, range(1, 201)) >= 0.99


@pytest.mark.parametrize("family", FAMILIES)
def test_a_clean_upload_takes_one_transfer_and_tells_its_progress(family):
    told = []
    scene = Scene(family)
    outcome = scene.upload(a_mission(20), progress=lambda what, done, total: told.append((what, done, total)))
    assert outcome.verified
    assert outcome.attempts == 1
    assert str(outcome) == "mission: verified; the vehicle holds what was sent, 20 items"
    items = 20 + (family == "ardupilot")
    assert [done for what, done, _ in told if what == "sending"] == list(range(items + 1))
    assert ("reading back", items, items) in told


@pytest.mark.parametrize("lasting", [3.0, 1e9], ids=["three seconds", "for good"])
@pytest.mark.parametrize("family", FAMILIES)
def test_a_cut_at_any_message_ends_verified_or_tells_what_the_vehicle_may_hold(family, lasting):
    messages = len(_whole(family).link.log)
    states = set()
    for at in range(messages):
        scene = with_old(family)
        before = scene.stored()
        cut = []

        def spoil(number, message, frame, up, scene=scene, cut=cut, at=at):
            if number >= at and not cut and message is not None and message.name.startswith("MISSION_"):
                cut.append(scene.lockstep.now_s)
            return b"" if cut and scene.lockstep.now_s < cut[0] + lasting else frame

        scene.link.spoil = spoil
        outcome = scene.upload(NEW)
        scene.lockstep.run_for(10.0)
        assert truthful(scene, outcome, NEW, before), (at, outcome)
        everything_was_read = at == messages - 1
        assert outcome.verified == (lasting < 10.0 or everything_was_read), (at, outcome)
        assert outcome.holds
        states.add(outcome.holds)
    assert lasting < 10.0 or len(states) > 1


def _whole(family):
    scene = with_old(family)
    assert scene.upload(NEW).verified
    return scene


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("name", ["MISSION_ACK", "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ITEM_INT"])
def test_each_first_message_of_a_kind_may_be_lost(family, name):
    for way in (True, False):
        scene, lost = with_old(family), []

        def spoil(number, message, frame, up, lost=lost, way=way):
            if message is not None and message.name == name and up == way and not lost:
                lost.append(number)
                return b""
            return frame

        scene.link.spoil = spoil
        assert scene.upload(NEW).verified
        assert scene.stored() == as_stored(NEW)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_vehicle_that_never_acknowledges_is_read_back(family):
    scene = Scene(family, spoil=lambda _n, m, frame, up: b"" if m and m.name == "MISSION_ACK" and not up else frame)
    assert scene.upload(NEW).verified


@pytest.mark.parametrize("family", FAMILIES)
def test_a_reboot_at_any_message_is_survived(family):
    for at in range(len(_whole(family).link.log) - 1):
        scene, done = with_old(family), []

        def spoil(number, message, frame, up, scene=scene, done=done, at=at):
            if number == at and not done:
                done.append(number)
                scene.vehicle.reboot_soon()
            return frame

        scene.link.spoil = spoil
        outcome = scene.upload(NEW)
        assert outcome.verified, (at, outcome)
        assert scene.stored() == as_stored(NEW)


@pytest.mark.parametrize("loss", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("family", FAMILIES)
def test_what_was_there_is_put_back_though_the_radio_is_bad(family, loss):
    """Item 3 is changed on its way for good; the old mission passes unchanged."""

    def spoil(_number, message, frame, up):
        if up and message and message.name == "MISSION_ITEM_INT" and message["seq"] == 3 and 89.0 > message["z"] > 30.0:
            return changed_frame(message, param1=9.0)
        return frame

    ends = set()
    for seed in range(1, 9):
        scene = with_old(family, impairment=bad_radio(loss), seed=seed)
        before = scene.stored()
        scene.link.spoil = spoil
        outcome = scene.upload(NEW)
        assert outcome.state in (UploadState.ROLLED_BACK, UploadState.UNKNOWN), outcome
        assert truthful(scene, outcome, NEW, before), outcome
        assert outcome.blocks_start == (outcome.state is UploadState.UNKNOWN)
        ends.add(outcome.state)
    assert UploadState.ROLLED_BACK in ends


@pytest.mark.parametrize("family", FAMILIES)
def test_an_acknowledgement_for_another_mission_is_not_ours(family):
    """Early, for a fence, for another station, or from another vehicle."""
    writer, others = FrameWriter(1, 1), FrameWriter(9, 1)

    def spoil(number, message, frame, up):
        if message is None or message.name != "MISSION_ITEM_INT" or not up:
            return frame
        false = [
            {"target_system": 255, "target_component": 190, "type": 0},
            {"target_system": 255, "target_component": 190, "type": 5, "mission_type": 1},
            {"target_system": 77, "target_component": 190, "type": 5},
        ]
        forged = b"".join(writer.frame("MISSION_ACK", fields) for fields in false)
        scene.link.inner.inbox.append(forged + others.frame("MISSION_ACK", false[0] | {"type": 5}))
        return frame

    scene = Scene(family)
    scene.link.spoil = spoil
    outcome = scene.upload(NEW)
    assert outcome.verified
    assert outcome.attempts == 1


@pytest.mark.parametrize("family", FAMILIES)
def test_an_item_that_is_answered_with_another_is_found(family):
    """The vehicle stores item 2 in the place of item 3."""
    second = []

    def spoil(number, message, frame, up):
        if message and message.name == "MISSION_ITEM_INT" and up:
            if message["seq"] == 2 and not second:
                second.append(message)
            elif message["seq"] == 3 and len(second) == 1:
                second.append(message)
                return changed_frame(second[0], seq=3)
        return frame

    scene = Scene(family, spoil=spoil)
    outcome = scene.upload(NEW)
    assert outcome.verified
    assert outcome.attempts == 2


@pytest.mark.parametrize("family", FAMILIES)
def test_a_refusal_names_the_item_and_leaves_what_was_there(family):
    wrong = Mission((*NEW.items[:3], MissionItem(Command.NAV_WAYPOINT, 1, z=5.0), *NEW.items[3:]))
    scene = with_old(family)
    before = scene.stored()
    outcome = scene.upload(wrong)
    assert outcome.state is (UploadState.REFUSED if family == "px4" else UploadState.ROLLED_BACK)
    assert outcome.items == (3,)
    assert outcome.reason.startswith("item 3: ")
    assert scene.stored() == before


@pytest.mark.parametrize("answer", [1, 14])
@pytest.mark.parametrize("family", FAMILIES)
def test_a_vehicle_that_never_takes_an_upload_says_so_within_half_a_minute(family, answer):
    scene, asked, its = with_old(family), [], FrameWriter(1, 1)
    refused = {"target_system": 255, "target_component": 190, "type": answer, "mission_type": 0}

    def spoil(number, message, frame, up):
        if up and message is not None and message.name == "MISSION_COUNT":
            asked.append(number)
            return b""
        answers = b"" if up else b"".join(its.frame("MISSION_ACK", refused) for _ in asked)
        asked[:] = asked if up else []
        return frame + answers

    before, begun_s = scene.stored(), scene.lockstep.now_s
    scene.link.spoil = spoil
    outcome = scene.upload(NEW)
    assert outcome.state is UploadState.REFUSED
    assert outcome.reason.startswith("the transfer was aborted")
    assert scene.stored() == before
    assert scene.lockstep.now_s < begun_s + 30.0


@pytest.mark.parametrize("answer", [1, 14, 15])
@pytest.mark.parametrize("family", FAMILIES)
def test_a_vehicle_that_ends_each_transfer_in_its_middle_has_not_stopped_answering(family, answer):
    scene, ended, its = with_old(family), [], FrameWriter(1, 1)
    refused = {"target_system": 255, "target_component": 190, "type": answer, "mission_type": 0}

    def spoil(number, message, frame, up):
        name = "" if message is None else message.name
        if name == "MISSION_COUNT" and up:
            ended.clear()
        if name == "MISSION_ITEM_INT" and up and message["seq"] >= 2:
            if not ended:
                scene.link.inner.inbox.append(its.frame("MISSION_ACK", refused))
            ended.append(number)
            return b""
        return b"" if name.startswith("MISSION_REQUEST") and not up and ended else frame

    scene.link.spoil = spoil
    outcome = scene.upload(NEW)
    assert not outcome.verified
    assert outcome.reason.startswith(f"the transfer was aborted: {in_words(answer)}")


@pytest.mark.parametrize("family", FAMILIES)
def test_a_vehicle_that_sends_items_as_floats_is_named(family):
    its = FrameWriter(1, 1)

    def spoil(number, message, frame, up):
        if up or message is None or message.name != "MISSION_ITEM_INT":
            return frame
        return its.frame("MISSION_ITEM", message.fields | {"x": message["x"] * 1e-7, "y": message["y"] * 1e-7})

    scene = Scene(family, spoil=spoil)
    outcome = scene.upload(NEW)
    assert outcome.state is UploadState.UNKNOWN
    assert "sends items as MISSION_ITEM" in outcome.reason
    assert outcome.blocks_start


def test_in_the_air_a_mixture_is_not_rolled_back_but_told():
    wrong = Mission((*NEW.items[:3], MissionItem(Command.NAV_WAYPOINT, 1, z=5.0), *NEW.items[3:]))
    scene = with_old("ardupilot")
    outcome = scene.upload(wrong, may_roll_back=lambda: False)
    assert outcome.state is UploadState.UNKNOWN
    assert "mixture" in outcome.holds
    assert outcome.items == (3,)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_second_station_uploading_at_the_same_time_never_makes_a_mixture_that_is_believed(family):
    for seed, loss in itertools.product(range(1, 6), (0.0, 0.1)):
        scene = Scene(family, impairment=bad_radio(loss), seed=seed)
        scene.meet()
        theirs = a_mission(8, height=120.0)
        link = scene.lockstep.connect(scene.vehicle, bad_radio(loss), seed=seed + 50)
        rival = Connection(Meddler(link), scene.lockstep.clock, system=250)
        job = UploadJob(Target(1, 1), family_named(family), theirs)
        outcomes = rival_outcome, ours = side_by_side((rival, upload_verified(job)), scene, scene.job(NEW))
        assert all(outcome is not None for outcome in outcomes)
        holds = scene.stored()
        assert ours.verified or rival_outcome.verified
        last = scene.ended[-1]
        if last.verified:
            assert holds == as_stored(NEW if last is ours else theirs), (seed, loss, ours, rival_outcome)


def side_by_side(rival, scene, job):
    """Two stations at once on one vehicle, each with its own connection."""
    ended = {}
    runs = {0: Stepped(*rival), 1: Stepped(scene.connection, upload_verified(job))}
    scene.ended = []
    while len(ended) < 2:
        for number, run in runs.items():
            if number not in ended and run.turn():
                ended[number] = run.result
                scene.ended.append(run.result)
        scene.lockstep.run_for(0.005)
    return ended[0], ended[1]


class Stepped:
    """A procedure that is carried out a little at a time, without waiting."""

    def __init__(self, connection, steps):
        self.connection, self.steps, self.current, self.result = connection, steps, None, None

    def turn(self):
        self.connection.pump(0.0)
        now = self.connection.clock.now_s()
        while self.current is None or self.current.done:
            try:
                self.current = next(self.steps)
            except StopIteration as end:
                self.result = end.value
                return True
            self.connection._exchange = self.current
            self.current.begin(now)
            self.connection._flush(self.current)
        if now >= self.current.next_s:
            self.current.tick(now)
        self.connection._flush(self.current)
        return False


@pytest.mark.parametrize("family", FAMILIES)
def test_without_an_answer_at_the_beginning_nothing_is_sent(family):
    scene = with_old(family)
    scene.link.spoil = lambda _n, _m, _frame, _up: b""
    outcome = scene.upload(NEW)
    assert outcome.state is UploadState.UNKNOWN
    assert outcome.attempts == 0
    assert "nothing was sent" in outcome.holds


@pytest.mark.parametrize("loss", [0.0, 0.2])
@pytest.mark.parametrize("family", FAMILIES)
def test_fences_and_rally_points_are_verified_too(family, loss):
    around = tuple(Point(i.x, i.y) for i in (waypoint(0), waypoint(3), waypoint(16)))
    fence = Geofence((FencePolygon(around, True),), (FenceCircle(around[1], 60.0, False),))
    rally = RallyPoints((RallyPoint(around[0], 30.0), RallyPoint(around[2], 40.0)))
    scene = Scene(family, impairment=bad_radio(loss))
    assert scene.upload(fence).verified
    assert scene.upload(rally).verified
    assert len(scene.stored(1)) == 4
    assert len(scene.stored(2)) == 2
    assert scene.upload(replace(fence, circles=())).verified
    assert len(scene.stored(1)) == 3


@pytest.mark.parametrize("family", FAMILIES)
def test_an_empty_mission_clears(family):
    scene = with_old(family)
    assert scene.upload(Mission()).verified
    assert scene.stored() == []


def test_a_vehicle_with_items_that_are_asked_for_twice_gets_them_twice():
    upload = Upload(Target(1), [], MissionKind.MISSION)
    upload.begin(0.0)
    assert upload.outbox[0][1]["count"] == 0
    assert upload.end is UploadEnd.RUNNING
    assert next(kind for kind in kinds().values() if kind.name == "MISSION_COUNT").base_bytes == 4


def test_a_mission_is_uploaded_to_a_peer_that_speaks_only_version_1():
    scene = Scene("ardupilot", parameters=(("SERIAL0_PROTOCOL", 1.0),))
    assert scene.upload(NEW).verified
    assert scene.connection.peers[1].version == 1
    assert scene.stored() == as_stored(NEW)


def test_link_loss_of_seconds_is_waited_out():
    scene = Scene("px4", faults=(Fault("link-loss", 6.0, 10.0),), impairment=bad_radio())
    scene.meet()
    scene.connection.run_for(4.8)
    assert scene.upload(a_mission(60)).verified


TWO_TAKEOFFS = Mission((*OLD.items[:3], waypoint(3, command=Command.NAV_TAKEOFF), *OLD.items[3:]))


def without_state(_number, message, frame, up):
    """PX4 1.16 does not tell the state of its mission."""
    if message is None or message.name != "MISSION_CURRENT" or up:
        return frame
    writer = FrameWriter(message.system, message.component)
    return writer.frame("MISSION_CURRENT", message.fields | {"mission_state": 0})


@pytest.mark.parametrize("spoil", [None, without_state], ids=["main", "1.16"])
@pytest.mark.parametrize("loss", [0.0, 0.05])
def test_a_mission_that_px4_takes_and_will_not_fly_is_refused_in_its_words(spoil, loss):
    scene = Scene("px4", impairment=bad_radio(loss), spoil=spoil)
    outcome = scene.upload(TWO_TAKEOFFS)
    assert outcome.state is UploadState.REFUSED
    assert outcome.blocks_start
    assert "takeoff is not the first" in outcome.reason
    assert outcome.holds == "what was sent, 6 items, which it will not fly"
    assert scene.stored() == as_stored(TWO_TAKEOFFS)
    again = scene.upload(OLD)
    assert again.verified
    assert not again.blocks_start


def test_a_mission_that_px4_will_not_fly_is_refused_though_its_words_are_lost():
    scene = Scene("px4", spoil=lambda _n, m, frame, _up: b"" if m and m.name == "STATUSTEXT" else frame)
    outcome = scene.upload(TWO_TAKEOFFS)
    assert outcome.state is UploadState.REFUSED
    assert outcome.infeasible


def test_words_about_something_else_refuse_nothing():
    """Nor do words about an item that was spoilt on its way, once it has come whole."""
    spoilt = []

    def spoil(number, message, frame, up):
        if up and message and message.name == "MISSION_ITEM_INT" and message["seq"] == 2 and not spoilt:
            spoilt.append(message)
            scene.vehicle.radio.say(4, "Geofence invalid, doesn't have consistent vertices")
            return changed_frame(message, frame=9)
        return without_state(number, message, frame, up)

    scene = Scene("px4", spoil=spoil)
    outcome = scene.upload(NEW)
    assert spoilt
    assert outcome.state is UploadState.REFUSED  # by the item, not by the verdict
    assert outcome.items == (2,)
    assert scene.upload(NEW).verified


def test_a_fence_that_is_verified_does_not_start_a_mission_that_is_unknown():
    scene = with_old("ardupilot")
    craft = Vehicle(scene.connection)
    dead = []

    def spoil(_number, message, frame, up):
        if up and message and message.name == "MISSION_ITEM_INT" and message["seq"] == 3:
            dead.append(message)
        return b"" if dead else frame

    scene.link.spoil = spoil
    assert craft.upload(NEW).state is UploadState.UNKNOWN
    scene.link.spoil = None
    around = tuple(Point(i.x, i.y) for i in (waypoint(0), waypoint(3), waypoint(16)))
    assert craft.upload(Geofence((FencePolygon(around, True),))).verified
    with pytest.raises(UploadMismatchError, match=r"start blocked.*mission: unknown.*mixture"):
        craft.start()
    assert craft.upload(NEW).verified
    assert craft.blocked is None


@pytest.mark.parametrize("family", FAMILIES)
def test_a_slow_link_is_learnt_and_not_flooded(family):
    """1.2 s there and back, longer than we wait at first: soon everything is sent once."""
    scene = Scene(family, impairment=bad_radio(delay_s=0.6, duplicate=0.0, reorder=0.0))
    scene.meet()
    sent = []
    for height in (40.0, 60.0):
        scene.link.log = []
        assert scene.upload(a_mission(40, height=height)).verified
        sent.append(sum(entry == ("MISSION_ITEM_INT", 1) for entry in scene.link.log))
    assert sent[0] < 2.5 * 41
    assert sent[1] <= 41 + 2
