"""Units of sentences: speeds in the unit that is preferred, and nothing else changed."""

from __future__ import annotations

import pytest

from skyway.web.preferences import Preferences


@pytest.mark.parametrize(
    ("speed", "told", "wanted"),
    [
        ("mps", "wind 8.0 m/s from 200", "wind 8.0 m/s from 200"),
        ("kmh", "ground speed 10 m/s to 12.5 m/s", "ground speed 36.0 km/h to 45.0 km/h"),
        ("kn", "5.14444 m/s", "10.0 kn"),
        ("kn", "climbs 3 m, 2 m/s2, for 30 min", "climbs 3 m, 2 m/s2, for 30 min"),
    ],
)
def test_speeds_of_a_sentence_are_told_in_the_unit_that_is_preferred(speed, told, wanted):
    assert Preferences(speed=speed).in_words(told) == wanted


def test_a_height_is_told_in_feet():
    assert Preferences(height="ft").height_text(30.48, 1) == "100.0 ft"
