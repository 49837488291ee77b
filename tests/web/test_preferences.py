"""Units of sentences: speeds, heights and lengths in the units that are preferred, and nothing else changed."""

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


@pytest.mark.parametrize(
    ("told", "wanted"),
    [
        ("wind on the way: 10 (8 to 12) m/s from 230°", "wind on the way: 19.4 (15.6 to 23.3) kn from 230°"),
        ("7.4 ± 0.8 m/s from 031°, seen at 60 m", "14.4 ± 1.6 kn from 031°, seen at 197 ft"),
        ("30 to 60 m above ground, -12.5 m at home.", "98 to 197 ft above ground, -41.0 ft at home."),
        ("m300 m, 4 m², 2 m/s², 12 km, 5 min, 3 mm, 7 m/min", "m300 m, 4 m², 2 m/s², 12 km, 5 min, 3 mm, 7 m/min"),
    ],
)
def test_all_figures_of_a_range_and_every_length_follow_the_units(told, wanted):
    assert Preferences(speed="kn", height="ft").in_words(told) == wanted
    assert Preferences().in_words(told) == told
