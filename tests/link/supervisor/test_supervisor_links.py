"""A link that is away for a while, at any exchange of a delivery, ends no delivery: what was asked is asked again."""

import random

import pytest
from cut_links import DIRECTIONS, DURATIONS_S, Cut, Moment, cut_stage, fly_cut, fly_each_cut, moments_of
from wires import Meddler, changed_frame

from benchmarks.link.deliveries import Stage, Story
from skyway.link.supervisor import read_journal
from skyway.sim_stub.faults import parse_fault

AUTOPILOTS = ("px4", "ardupilot")
SHORT_S = 120.0


def delivery(autopilot):
    """One that charges first, so that every state on the ground is passed."""
    return Story(autopilot=autopilot, start="bellevue", to="city-hall", soc=0.3, traffic=False)


def short_delivery(autopilot):
    """The shortest there is that charges first."""
    return Story(autopilot=autopilot, start="jersey-city", to="hoboken", soc=0.38, traffic=False)


ONCE_IN_EACH_STATE = (
    Cut(Moment("connecting", "COMMAND_LONG:511:245"), "both", 20.0),
    Cut(Moment("waiting-for-pad", "pads:charge"), "both", 30.0),
    Cut(Moment("charging", "COMMAND_LONG:42651"), "up", 30.0),
    Cut(Moment("preflight", "COMMAND_LONG:512:242"), "up", 40.0),
    Cut(Moment("uploading", "MISSION_ITEM_INT:0"), "both", 40.0),
    Cut(Moment("arming", "COMMAND_LONG:400:1"), "down", 4.0),
    Cut(Moment("flying", "COMMAND_LONG:511:30"), "up", 30.0),
    Cut(Moment("landed", "COMMAND_LONG:211"), "down", 20.0),
)
"""What is asked, cut off at once: some of it is carried out, and only the answer is lost."""


@pytest.mark.parametrize("autopilot", ["px4", pytest.param("ardupilot", marks=pytest.mark.slow)])
def test_a_link_that_is_cut_for_seconds_in_every_state_delays_a_delivery_and_does_not_end_it(autopilot, tmp_path):
    stage, link = cut_stage(delivery(autopilot), tmp_path, ONCE_IN_EACH_STATE)
    outcome = stage.fly()
    assert outcome.delivered, outcome
    assert set(link.begun_s) == set(ONCE_IN_EACH_STATE)
    assert stage.craft.station() == "city-hall"
    assert sum(event.text == "in the air" for event in stage.world.events) == outcome.flights
    said = [record.reason for record in read_journal(stage.journal_path).records if record.event in ("link", "state")]
    assert any("reset the battery's counter" in reason for reason in said)
    assert any("release the package" in reason for reason in said)


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_an_upload_of_ours_that_is_told_of_after_a_cut_is_not_somebody_elses(autopilot, tmp_path):
    cuts = [Cut(Moment("ready"), direction, lasts_s) for direction in ("both", "down") for lasts_s in (4.5, 5.0, 5.5)]
    ended = fly_each_cut(short_delivery(autopilot), tmp_path, cuts)
    assert {end.kind for end in ended.values()} == {"delivered"}, ended


def test_another_drone_of_the_same_id_that_answers_after_a_lost_link_is_not_ours(tmp_path):
    """It may stand at the destination, and the delivery would be over."""
    stage = Stage(
        Story(start="jersey-city", to="hoboken", traffic=False, faults=(parse_fault("link-loss@100s+30s"),)), tmp_path
    )
    back_s, doubles = [], []

    def spoil(number, message, frame, up):
        if up or message is None:
            return frame
        now_s = stage.lockstep.now_s
        if now_s > 130.0 and not back_s:
            back_s.append(now_s)
        if message.name == "AUTOPILOT_VERSION" and back_s and now_s < back_s[0] + 20.0:
            doubles.append(now_s)
            return changed_frame(message, uid=77)
        return frame

    connect = stage.lockstep.connect
    stage.lockstep.connect = lambda *given, **named: Meddler(connect(*given, **named), spoil)
    outcome = stage.fly()
    assert doubles
    assert outcome.delivered, outcome
    said = [record for record in read_journal(stage.journal_path).records if record.event == "link"]
    (strange,) = [record for record in said if "is not the drone of this delivery" in record.reason]
    (back,) = [record for record in said if "the link is back" in record.reason]
    assert back.time_s > strange.time_s + 10.0


def test_a_cut_as_telemetry_is_asked_for_leaves_nothing_unknown_that_comes_a_second_later(tmp_path):
    cut = Cut(Moment("connecting", "COMMAND_LONG:511:33"), "down", 5.0)
    ended = fly_cut(short_delivery("ardupilot"), tmp_path, cut)
    assert ended.kind == "delivered", ended


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
@pytest.mark.parametrize("part", range(12))
def test_wherever_a_cut_of_a_second_to_half_an_hour_begins_the_delivery_arrives(autopilot, part, tmp_path):
    """Every exchange and state, in each direction, with every duration."""
    story = short_delivery(autopilot)
    cuts = [
        Cut(moment, direction, lasts_s)
        for moment in moments_of(story, tmp_path / "undisturbed")[part::12]
        for direction in (("both",) if moment.exchange.startswith("pads:") else DIRECTIONS)
        for lasts_s in DURATIONS_S
    ]
    ended = fly_each_cut(story, tmp_path / "cut", cuts)
    assert not {
        cut: end
        for cut, end in ended.items()
        if end.kind != "delivered" and (end.kind != "held" or cut.lasts_s <= SHORT_S)
    }


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_many_cuts_in_one_delivery_end_in_no_harm(seed, tmp_path):
    luck = random.Random(f"cuts/{seed}")
    story = delivery(AUTOPILOTS[seed % 2])
    moments = moments_of(story, tmp_path / "undisturbed")
    cuts = [Cut(moment, luck.choice(DIRECTIONS), luck.choice(DURATIONS_S[:5])) for moment in luck.sample(moments, 12)]
    ended = fly_cut(story, tmp_path / "cut", *cuts)
    assert ended.kind == "delivered", ended
