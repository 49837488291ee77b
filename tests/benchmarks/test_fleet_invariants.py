"""The judge of a flown fleet finds each fault that is put into a history that is right."""

import json
import sqlite3
from collections import Counter

import pytest

from benchmarks.fleet.day.faults import KINDS, schedule
from benchmarks.fleet.invariants import judge


def flight(drone, phase, origin, destination, *, order="o1", station=None, arrived=True, soc=0.5, ended=True):
    end = {"station": station or destination, "arrived": arrived, "soc": soc}
    steps = [{"origin": origin, "destination": destination}]
    return {"drone": drone, "phase": phase, "order": order, "steps": steps, "end": end if ended else None}


GOOD = [
    ("drone", "d1", "standing", {"place": "a"}),
    ("order", "o1", "new", {"order": {"origin": "b"}, "reason": ""}),
    ("order", "o2", "refused", {"order": {"origin": "b"}, "reason": "too late"}),
    ("flight", "1 d1", "ordered", flight("d1", "to the package", "a", "b", ended=False)),
    ("flight", "1 d1", "closed", flight("d1", "to the package", "a", "b")),
    ("flight", "2 d1", "ordered", flight("d1", "with the package", "b", "c", ended=False)),
    ("drone", "d1", "flying", {"place": "b"}),
    ("flight", "2 d1", "closed", flight("d1", "with the package", "b", "c")),
    ("order", "o1", "delivered", {"order": {"origin": "b"}, "reason": ""}),
    ("drone", "d1", "standing", {"place": "c"}),
]
PADS = [("o1", 1, 1, "c", 1, 0, 10, "firm"), ("o1", 1, 1, "c", 1, 0, 10, "released"), ("o2", 1, 1, "c", 1, 5, 9, "firm"), ("o2", 1, 1, "c", 1, 5, 9, "released")]  # fmt: skip


def judged(folder, lines=GOOD, pads=PADS, **how):
    name = str(folder / "ledger.db")
    versions = {}
    with sqlite3.connect(name) as ledger:
        ledger.execute(
            "CREATE TABLE desk_history (seq INTEGER PRIMARY KEY, dispatcher, kind, id, version INTEGER, state, document)"
        )
        ledger.execute(
            "CREATE TABLE history (seq INTEGER PRIMARY KEY, itinerary, version, number, station, pad, starts, ends, epsilon, state)"
        )
        for kind, id_, state, document in lines:
            versions[kind, id_] = versions.get((kind, id_), 0) + 1
            row = ("dispatch", kind, id_, versions[kind, id_], state, json.dumps(document))
            ledger.execute(
                "INSERT INTO desk_history (dispatcher, kind, id, version, state, document) VALUES (?, ?, ?, ?, ?, ?)",
                row,
            )
        for *row, state in pads:
            ledger.execute(
                "INSERT INTO history (itinerary, version, number, station, pad, starts, ends, epsilon, state) VALUES (?, ?, ?, ?, ?, ?, ?, 0.0, ?)",
                (*row, state),
            )
    return judge(name, **how)


def test_what_is_right_is_right(tmp_path):
    found = judged(tmp_path)
    assert found.wrong == []
    assert found.figures["orders delivered"] == found.figures["orders refused"] == 1.0


def test_landings_are_those_of_the_journals(tmp_path):
    """A drone that stood until it was empty has an end, and no landing."""
    service = ("service", "service", "ended", {"folder": str(tmp_path)})
    lines = [
        service,
        *((kind, id_, state, told | ({"journal": f"{id_}.jsonl"} if kind == "flight" else {})) for kind, id_, state, told in GOOD),
    ]  # fmt: skip
    landed = [json.dumps({"event": "landed", "data": {"soc": soc}}) for soc in (0.42, 0.18, 0.196)]
    (tmp_path / "1 d1.jsonl").write_text(
        "\n".join([json.dumps({"event": "end", "data": {"soc": 0.05}}), *landed, '{"event": "lan'])
    )
    found = judged(tmp_path, lines)
    assert found.wrong == []
    assert found.figures["landings"] == 3.0
    assert found.figures["landings below the reserve"] == 1.0


def changed(number, state=None, document=None):
    lines = list(GOOD)
    kind, id_, was, told = lines[number]
    lines[number] = (kind, id_, state or was, document or told)
    return lines


@pytest.mark.parametrize(
    ("lines", "pads", "problem"),
    [
        (changed(8, "under way"), PADS, "order o1 is forgotten"),
        ([*GOOD, GOOD[8], ("order", "o1", "refused", GOOD[8][3])], PADS, "ended more than once"),
        (changed(2, document={"order": {"origin": "b"}, "reason": ""}), PADS, "without a reason"),
        (changed(7, document=flight("d1", "with the package", "b", "c", arrived=False)), PADS, "0 flights arrived"),
        (changed(7, document=flight("d1", "with the package", "x", "c")), PADS, "begins at x, but it stands at b"),
        ([*GOOD[:4], ("flight", "9 d1", "ordered", GOOD[3][3]), *GOOD[4:]], PADS, "two flights at once"),
        (changed(7, document=flight("d1", "with the package", "b", "c", ended=False)), PADS, "never ended"),
        (changed(9, "flying"), PADS, "no person was informed"),
        (GOOD, [PADS[0], PADS[2], PADS[1], PADS[3]], "held twice"),
        (GOOD, PADS[:3], "still booked"),
    ],
)
def test_each_fault_is_found(tmp_path, lines, pads, problem):
    assert any(problem in one for one in judged(tmp_path, lines, pads).wrong)


@pytest.mark.parametrize(
    ("lines", "pads", "right"),
    [
        (GOOD[:6], PADS[:1], True),  # an order, a flight, a drone and a pad under way
        (changed(9, "flying"), PADS, True),
        (GOOD[:7], [PADS[0], PADS[2]], False),
        ([*GOOD[:4], ("flight", "9 d1", "ordered", GOOD[3][3])], PADS, False),
    ],
)
def test_what_is_under_way_is_open_while_it_runs_and_nothing_else(tmp_path, lines, pads, right):
    assert (judged(tmp_path, lines, pads, running=True).wrong == []) is right


def test_every_kind_of_fault_comes_in_turn_and_the_same_each_time():
    due = schedule(7, 24.0, 900.0)
    assert due == schedule(7, 24.0, 900.0)
    assert due != schedule(8, 24.0, 900.0)
    assert [one.at_s for one in due] == sorted(one.at_s for one in due)
    counts = Counter(one.kind for one in due)
    assert set(counts) == set(KINDS)
    assert max(counts.values()) - min(counts.values()) <= 1
    assert 0.6 < len(due) / (24.0 * 4.0) < 1.5
