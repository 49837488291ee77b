"""Errors: one line a person can act on, every fault carried, one tree to catch."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.base.errors import (
    Fault,
    InfeasibleError,
    InputError,
    LinkError,
    NoRouteError,
    PayloadError,
    SkywayError,
    one_line,
)


def test_a_fault_names_file_line_field_value_and_what_would_be_right():
    fault = Fault("out of range", "stations.csv", 3, "lat", 95.0, "degrees from -90 to 90")
    assert str(fault) == "stations.csv:3: lat: out of range (got '95.0'); degrees from -90 to 90"


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        (Fault("is empty"), "is empty"),
        (Fault("is empty", "a.csv"), "a.csv: is empty"),
        (Fault("is empty", line=7), "line 7: is empty"),
        (Fault("is missing", field="drone.id"), "drone.id: is missing"),
        (Fault("is 0", value=0), "is 0 (got '0')"),
    ],
)
def test_a_fault_says_only_what_it_knows(fault, text):
    assert str(fault) == text


def test_a_long_value_is_cut():
    assert len(str(Fault("is not a number", value="9" * 10_000))) < 100


@given(problem=st.text(), file=st.text(), field=st.text(), value=st.text(), remedy=st.text())
def test_a_fault_is_one_printable_line_whatever_a_file_held(problem, file, field, value, remedy):
    text = str(Fault(problem, file, None, field, value, remedy))
    assert text.isprintable()
    text.encode()


def test_escape_codes_and_lone_surrogates_reach_no_terminal():
    assert one_line("a\x1b[2Jb\ud800c\nd") == "a [2Jb c d"
    assert one_line("Spital Zürich Süd") == "Spital Zürich Süd"


def test_an_input_error_carries_all_faults_and_prints_one_line_each():
    error = InputError([Fault("is empty", field="id"), Fault("is 3", field="pads")])
    assert [fault.field for fault in error.faults] == ["id", "pads"]
    assert str(error) == "id: is empty\npads: is 3"


def test_a_text_or_one_fault_makes_an_input_error_too():
    assert InputError("no").faults == InputError(Fault("no")).faults == (Fault("no"),)


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (InputError("no"), 2),
        (NoRouteError("no", constraint="energy"), 1),
        (PayloadError("no"), 1),
        (LinkError("no"), 3),
    ],
)
def test_every_error_is_caught_as_a_skyway_error_and_has_its_exit_code(error, code):
    assert isinstance(error, SkywayError)
    assert error.exit_code == code


def test_no_route_names_the_binding_constraint():
    assert NoRouteError("too far", constraint="energy").constraint == "energy"
    assert PayloadError("too heavy").constraint == "payload"
    assert isinstance(PayloadError("too heavy"), InfeasibleError)


def test_an_input_error_is_a_value_error_to_who_does_not_know_skyway():
    assert isinstance(InputError("no"), ValueError)
