"""Tables: whatever the width, nothing is cut; in a pipe every row is one line."""

import pytest
from cli_requests import HOP, TRIP
from rich.cells import cell_len

from skyway.cli.sheet import Column, Sheet, wrapped

COMMANDS = {
    "plan": ("plan", *TRIP, "--drone", "m300"),
    "compare": ("compare", *HOP, "--drone", "m300", "--planners", "robust,pfs"),
    "wind": ("wind", "--depart", "2013-07-10T14:00-04:00", "--hours", "3"),
    "network": ("network",),
    "scenario check": ("scenario", "check"),
    "explained": ("plan", *HOP, "--explain", "--alternatives", "2", "--depart-window", "1h"),
}


def words(text):
    return sorted(text.replace("─", "").split())


@pytest.mark.parametrize("arguments", COMMANDS.values(), ids=COMMANDS.keys())
@pytest.mark.parametrize("columns", [60, 80, 100, 200])
def test_no_line_is_wider_than_the_terminal_and_no_name_is_cut(skyway, monkeypatch, arguments, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    shown = skyway(*arguments)
    assert shown.code == 0, shown.err
    assert max(cell_len(line) for line in shown.out.splitlines()) <= columns
    assert "…" not in shown.out.replace(" … ", "")
    if arguments[0] == "plan":
        assert f"{arguments[4]}: delivered" in shown.out
    if arguments[0] == "network":
        assert "Staten Island University Hospital North (Ocean Breeze), Staten Island" in " ".join(shown.out.split())


def test_a_long_leg_keeps_its_destination_in_a_pipe(skyway, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    out = skyway(*COMMANDS["plan"]).out
    assert any(" > (" in line and "km" not in line and "m/s" not in line and "%" in line for line in out.splitlines())
    assert "…" not in out


def test_a_narrow_table_holds_the_same_values():
    sheet = Sheet([Column("leg", justify="left"), Column("wind", "m/s"), Column("charge", words="charge {} %")])
    sheet.add("a > (b) > a-very-long-destination", "8 (5 to 11)", "50 > 20")
    sheet.note("a stop")
    sheet.add("東京 > b", "7", "40 > 20")
    wide, narrow = sheet.lines(None), sheet.lines(30)
    assert len(wide) == 6
    assert all(cell_len(line) <= 36 for line in narrow)
    for value in ("8 (5 to 11)", "50 > 20", "a-very-long-destination", "東京", "a stop"):
        assert any(value in line for line in wide)
        assert value in " ".join(" ".join(narrow).split())


def test_a_line_is_broken_between_words_only():
    text = "one two-three four " * 10
    assert " ".join(" ".join(wrapped(text, 24)).split()) == text.strip()
    assert all(len(line) <= 24 for line in wrapped(text, 24))
    assert wrapped(text, None) == [text]
