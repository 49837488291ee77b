"""Fuzzing ends in time, says how much it did, and tells what must not be."""

import json
import math
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT))

from benchmarks.fuzz import __main__ as fuzz  # noqa: E402
from benchmarks.fuzz.cases import draw  # noqa: E402
from benchmarks.fuzz.online import WAYS, draw_online  # noqa: E402
from skyway.planner.plan import plan  # noqa: E402
from skyway.planner.registry import PLANNERS  # noqa: E402

END = {"end": 7, "planner": "pfs", "ended": "plan", "s": 0.1}
SLEEP = "import time; time.sleep(600)"


def child(program, monkeypatch):
    """Let another program answer in the place of the planners."""
    monkeypatch.setattr(fuzz, "CHILD", [sys.executable, "-c", program])


def says(*rows):
    return "".join(f"print({json.dumps(row)!r}, flush=True)\n" for row in rows)


def test_a_child_that_compiles_past_the_deadline_is_stopped_and_none_answered_is_a_failure(monkeypatch, capsys):
    child(says({"begin": 0}) + SLEEP, monkeypatch)
    begun = time.monotonic()
    assert fuzz.main(["--strict", "--seconds", "1"]) == 1
    assert time.monotonic() - begun < 20.0
    told = capsys.readouterr().out
    assert "0 of 20000 requests answered" in told
    assert "no request was answered" in told
    assert "FOUND" not in told


@pytest.mark.slow
def test_what_was_answered_before_the_deadline_is_counted(monkeypatch, capsys):
    child(says({"begin": 7}, END, {"begin": 8}) + SLEEP, monkeypatch)
    assert fuzz.main(["--strict", "--seconds", "3"]) == 0
    assert "1 of 20000 requests answered" in capsys.readouterr().out


def test_a_child_that_dies_is_a_finding_and_the_next_request_is_asked(monkeypatch):
    child("import sys\n" + says({"begin": 7}) + "sys.exit(int(sys.argv[1]) == 7)", monkeypatch)
    tally = fuzz.run(7, 3)
    assert tally.findings == ["#7 the process died: 1"]


def test_a_figure_that_is_not_finite_on_the_way_is_a_finding(monkeypatch):
    monkeypatch.setattr(fuzz, "carry_on", lambda _: iter([("soc", 0.5), ("soc", math.nan)]))
    with pytest.raises(fuzz.FindingError, match="soc is nan"):
        fuzz.judge_online(draw(0))


def test_requests_cover_every_planner_and_every_way_on():
    cases = [draw(number) for number in range(250)]
    assert {case.planner for case in cases} == set(PLANNERS)
    assert {draw_online(case).way for case in cases} == set(WAYS)


@pytest.mark.parametrize("number", [28, 35, 39, 42])  # one quick one for each way on
def test_random_requests_end_in_a_plan_or_an_error_of_ours_and_so_does_what_follows(number):
    case = draw(number)
    assert fuzz.judge(case)
    assert fuzz.judge_online(case)


def test_an_arrival_in_the_first_cell_of_time_is_followed_no_further_than_any_other():
    """Fuzzing, #6036: a cell begins before the departure; "as far as can be" times less than nothing was a negative count of cells."""
    case = draw(6036)
    wind = case.wind.member(6)
    assert plan(case.scenario, case.request, planner="exact", forecast=wind).complete
