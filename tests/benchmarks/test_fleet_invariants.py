"""The judge of a flown fleet finds each fault that is put into a history that is right."""

import json
import sqlite3

import pytest

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


def judged(folder, lines=GOOD, pads=PADS):
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
    return judge(name)


def test_what_is_right_is_right(tmp_path):
    found = judged(tmp_path)
    assert found.wrong == []
    assert found.figures["orders delivered"] == found.figures["orders refused"] == 1.0
    assert found.figures["landings"] == 2.0


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
        (changed(9, "flying"), PADS, "nobody was told"),
        (GOOD, [PADS[0], PADS[2], PADS[1], PADS[3]], "held twice"),
        (GOOD, PADS[:3], "still booked"),
    ],
)
def test_each_fault_is_found(tmp_path, lines, pads, problem):
    assert any(problem in one for one in judged(tmp_path, lines, pads).wrong)
