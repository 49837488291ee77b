"""Parameters that a mission relies on, and whether a vehicle's values will do."""

import pytest
from settings_page import PAGE, page

from skyway.missions.autopilots.registry import FAMILIES
from skyway.missions.autopilots.settings import version_of
from skyway.missions.items.parameters import FlightNeeds, Parameter, dumps
from skyway.models.base.errors import InputError


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


def test_the_page_of_parameters_is_that_of_their_tables():
    assert PAGE.read_text() == page(), "run: python tests/missions/settings_page.py"


@pytest.mark.parametrize("autopilot", FAMILIES.values(), ids=FAMILIES)
def test_every_need_has_one_name_in_every_version(autopilot):
    needs = autopilot.parameters(FlightNeeds(10.0, 3.0, 2.0, 60.0, True, True, True, True, True))
    for version in autopilot.firmwares:
        chosen = [autopilot.settings.in_version(need, version_of(version)) for need in needs]
        assert None not in chosen
        text = autopilot.parameter_file(needs, version)
        written = [line.partition(",")[0] for line in text.splitlines() if not line.startswith("#")]
        assert written == [way.name for way in chosen if way.value is not None]


def test_a_version_is_read_or_refused():
    assert version_of("v1.16.1") == (1, 16)
    assert version_of("4.7.0-dev") == (4, 7)
    assert version_of("main") > version_of("4.8")
    for wrong in ("", "four", "4", "4.x"):
        with pytest.raises(InputError, match="major and minor"):
            version_of(wrong)


def test_a_name_that_a_person_gives_must_have_a_unit_of_that_meaning():
    speed = FAMILIES["ardupilot"].settings["mission-speed"].need("at-least", 12.0, "why")
    assert speed.called("NEW", "cm/s").value == pytest.approx(1200.0)
    for unit in ("m", "deg", "", "knots"):
        with pytest.raises(InputError, match="not a unit of ground speed"):
            speed.called("NEW", unit)
