"""Parameters that a mission relies on, and whether a vehicle's values will do."""

import pytest

from missions.parameters import Parameter, dumps


@pytest.mark.parametrize(
    ("rule", "value", "good", "bad"),
    [
        ("equal", 1.2, 1.2000000477, 1.3),
        ("at-least", 60.0, 80.0, 59.0),
        ("at-most", 60.0, 59.0, 80.0),
        ("bits", 11, 27, 3),
    ],
)
def test_a_value_will_do_or_not(rule, value, good, bad):
    parameter = Parameter("X", rule, value, "because")
    assert parameter.accepts(good)
    assert not parameter.accepts(bad)


def test_what_must_only_be_read_accepts_anything():
    assert Parameter("X", "read", None, "because").accepts(-3.0)


def test_the_file_is_one_that_mission_planner_reads():
    text = dumps((Parameter("RTL_ALT", "at-least", 6000.0, "clear the ground"), Parameter("B", "read", None, "know")))
    settings = [line for line in text.splitlines() if not line.startswith("#")]
    assert settings == ["RTL_ALT,6000"]
    assert "# B: read it" in text
