"""What people order of a flight: which orders there are, who may give them, that each counts once, and what the drone does."""

import time
from collections import deque
from dataclasses import dataclass, field

import pytest

from benchmarks.link.deliveries import Stage, Story
from skyway.link.supervisor import read_journal
from skyway.link.supervisor.command.commander import SILENT_S, Commander
from skyway.link.supervisor.command.request_file import MAX_LINE, Request, RequestFile, request
from skyway.link.supervisor.journal.entries import Ordered
from skyway.link.supervisor.operators import Said

STORY = Story(start="jersey-city", to="hoboken", soc=0.9, traffic=False, still=True)
ANNA, BEN = {"who": "a", "name": "Anna"}, {"who": "b", "name": "Ben"}


@dataclass
class People:
    """Somebody who says something as soon as something is so; the question before a take-off is answered by Anna."""

    script: deque
    interrupts: int = 0
    present: bool = True
    lines: list = field(default_factory=list)
    count: int = 0
    due: deque = field(default_factory=deque)
    answered: int = 0

    def tell(self, line):
        self.lines.append(line)

    ask = tell

    def next_input(self):
        return self.due.popleft() if self.due else None

    def say(self, word, who=ANNA, **more):
        self.count += 1
        self.due.append(Said(word, **({"id": f"{word}-{self.count}"} | who | more)))

    def tick(self, context):
        talk = context.conversation
        if talk.question and talk.question_n != self.answered:
            self.answered = talk.question_n
            self.say("yes", about=talk.question_n)
        if self.script and self.script[0][0](context):
            for one in self.script.popleft()[1:]:
                self.say(*one) if isinstance(one, tuple) else self.due.append(one)


def connected(context):
    return context.state == "connecting"


def cruising(context):
    sample = context.observed.sample
    return context.state == "flying" and sample is not None and context.now_s > context.delivery.leg.start_s + 60.0


def slow(context):
    return context.conversation.paused and context.observed.sample.ground_speed_mps < 1.0


def flown(tmp_path, *script, **more):
    people = People(deque([(connected, ("take",)), *script]))
    stage = Stage(Story(**{**vars(STORY), **more}), tmp_path, people)
    outcome = stage.fly(on_tick=people.tick)
    assert not people.script, people.script
    orders = [r.entry(Ordered) for r in read_journal(stage.journal_path).records if r.event == "order"]
    return outcome, orders, stage


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_flight_is_paused_by_the_one_who_has_command_once_and_goes_on(autopilot, tmp_path):
    twice = Said("pause", id="once", **ANNA)
    outcome, orders, _ = flown(
        tmp_path,
        (cruising, ("pause", BEN), Said("pause", id="old", age_s=99.0, **ANNA), ("charged",), twice, twice),
        (slow, ("go",)),
        autopilot=autopilot,
    )
    assert outcome.delivered
    told = [(one.word, one.name, one.done) for one in orders]
    assert told == [
        ("take", "Anna", "taken"), ("yes", "Anna", "taken"), ("pause", "Ben", "refused"), ("pause", "Anna", "refused"),
        ("charged", "Anna", "refused"), ("pause", "Anna", "taken"), ("pause", None, "done"), ("go", "Anna", "taken"), ("go", None, "done"),
    ]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize(
    ("order", "ends", "station"),
    [
        ("return", "stopped-safe", "jersey-city"),
        ("land", "landed-elsewhere", None),
        ("leave", "left-to-itself", None),
        ("stay", "delivered", "hoboken"),
    ],
)
def test_what_each_order_ends_in(order, ends, station, autopilot, tmp_path):
    outcome, orders, _ = flown(tmp_path, (cruising, (order,)), autopilot=autopilot)
    assert (outcome.state, outcome.station) == (ends, station)
    assert [(one.word, one.done) for one in orders][2:] == [(order, "taken")]


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_drone_that_was_diverted_by_hand_goes_on_from_there_and_may_be_sent_back_meanwhile(autopilot, tmp_path):
    def turned(context):
        return context.state == "diverting" and context.divert.turned

    outcome, orders, stage = flown(
        tmp_path,
        (cruising, ("divert jersey-city",)),
        (turned, ("pause",)),
        (slow, ("divert hoboken",)),
        autopilot=autopilot,
    )
    assert outcome.delivered
    assert [one.done for one in orders[2:]] == ["taken", "taken", "done", "taken"]
    assert outcome.flights == 1
    assert stage.world.vehicles[1].station() == "hoboken"


@pytest.mark.slow
def test_a_drone_that_stands_in_the_air_for_too_long_is_diverted_by_its_supervisor(tmp_path):
    outcome, _, stage = flown(tmp_path, (cruising, ("pause",)), soc=0.42)
    records = read_journal(stage.journal_path).records
    acts = [r.data["action"] for r in records if r.event == "decision" and r.flight == 1 and r.state != "replanning"]
    assert "divert" in acts or "land" in acts
    assert outcome.station is not None


def test_command_goes_to_who_asks_when_it_is_given_or_its_holder_is_silent_and_never_otherwise():
    command = Commander()
    assert "nobody has command" in command.refuse(Said("pause", **ANNA))
    assert command.hear(Said("take", **ANNA), 0.0)[0]
    assert command.refuse(Said("pause", **ANNA)) == ""
    assert "Anna has command" in command.refuse(Said("pause", **BEN))
    assert not command.hear(Said("give", **ANNA), 0.0)[0]
    assert command.hear(Said("take", **BEN), 1.0)[0]
    assert not command.hear(Said("give", **BEN), 1.0)[0]
    assert command.hear(Said("keep", **ANNA), 2.0)[0]
    assert command.overdue(1e9) == ""
    assert command.hear(Said("take", **BEN), 10.0)[0]
    assert command.overdue(10.0 + SILENT_S - 0.1) == ""
    assert "Anna had not answered" in command.overdue(10.0 + SILENT_S)
    assert command.refuse(Said("pause", **BEN)) == ""
    assert command.hear(Said("take", **ANNA), 40.0)[0]
    assert command.hear(Said("give", **BEN), 40.0)[0]
    assert command.holder.name == "Anna"


def test_a_file_of_requests_gives_each_line_once_whatever_else_is_in_it(tmp_path):
    path = tmp_path / "flight.orders"
    file = RequestFile(path, lambda _: None)
    assert path.stat().st_mode & 0o077 == 0
    one = Request(id="1", word="pause", who="a", name="An\x1bna", time_s=time.time() - 5.0)
    request(path, one)
    with path.open("ab") as raw:
        raw.write(b'nonsense\n{"id": 3}\n\n' + b"[" * 90_000 + b"\n\xff\xfe\n" + b"x" * (3 * MAX_LINE) + b"\n")
    request(path, Request(id="2", word="divert columbia", who="b", name="Ben", time_s=time.time(), about=7))
    with path.open("ab") as raw:
        raw.write(b'{"id":"3","word":"go","who":"a","na')
    found = [said for _ in range(9) if (said := file.next_input()) is not None]
    assert [(said.id, said.word, said.name, said.about) for said in found] == [
        ("1", "pause", "Anna", None), ("2", "divert columbia", "Ben", 7),
    ]  # fmt: skip
    assert 4.0 < found[0].age_s < 60.0
    with path.open("ab") as raw:
        raw.write(b'me":"Anna","time_s":0}\n')
    assert file.next_input().id == "3"
    assert file.next_input() is None
