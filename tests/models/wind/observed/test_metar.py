"""METARs: the wind group and the time, against reports decoded by hand, by others, and written here."""

import json
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.base.errors import InputError
from skyway.models.base.table import FaultCollector
from skyway.models.wind.observed.metar import nearest_s, parse_metars

KNOT, KMH = 1852.0 / 3600.0, 1.0 / 3.6
NEAR = datetime(2023, 10, 17, 6, 30, tzinfo=UTC).timestamp()


def winds(text, near_s=NEAR):
    faults = FaultCollector("metar.txt")
    found = parse_metars(text, near_s, faults)
    faults.raise_if_any()
    return found


def refused(text):
    with pytest.raises(InputError) as error:
        winds(text)
    return str(error.value)


# Decoded by hand, after WMO-No. 306 FM 15 (15.5) and FMH-1 chapter 12: (text, speed m/s, from, gust m/s)
BY_HAND = [
    ("KEWR 170551Z 09010KT 10SM FEW085 11/07 A2979", 10 * KNOT, 90.0, None),
    ("METAR UUEE 170600Z 21005MPS 9999 BKN020 05/03 Q1012 NOSIG=", 5.0, 210.0, None),
    ("ZBAA 170600Z 36018KMH 9999", 18 * KMH, 360.0, None),
    ("SPECI KJFK 170605Z AUTO 22015G27KT 3SM RA", 15 * KNOT, 220.0, 27 * KNOT),
    ("KLGA 170551Z COR 31012KT 10SM CLR", 12 * KNOT, 310.0, None),
    ("CYYZ 170600Z CCA 27008KT 15SM", 8 * KNOT, 270.0, None),
    ("KLGA 170551Z 00000KT 10SM CLR", 0.0, None, None),
    ("KEWR 170551Z VRB03KT 10SM", 3 * KNOT, None, None),
    ("KEWR 170551Z VRB03G18KT 10SM", 3 * KNOT, None, 18 * KNOT),
    ("LFPG 170600Z 18012G25KT 150V210 9999", 12 * KNOT, 180.0, 25 * KNOT),
    ("KMWN 170550Z 280102G120KT 1/16SM", 102 * KNOT, 280.0, 120 * KNOT),
    ("NZWP 170555Z 240P99KT 0050", 99 * KNOT, 240.0, None),
    ("EDDB 170620Z AUTO /////KT 9999", None, None, None),
    ("EDDB 170620Z AUTO ///05KT 9999", None, None, None),
    ("EDDB 170620Z AUTO 270//KT 9999", None, 270.0, None),
    ("KEWR 170551Z NIL=", None, None, None),
    ("KEWR 170551Z 10SM CLR", None, None, None),
    ("EGLL 170620Z 24010KT 9999 TEMPO 27025G40KT", 10 * KNOT, 240.0, None),
    ("KJFK 170551Z 10SM CLR RMK AO2 PK WND 28045/0512", None, None, None),
]


@pytest.mark.parametrize(("text", "speed", "degrees", "gust"), BY_HAND)
def test_reports_decoded_by_hand(text, speed, degrees, gust):
    (one,) = winds(text)
    assert one.speed_mps == (None if speed is None else pytest.approx(speed))
    assert (one.from_deg, one.gust_mps) == (degrees, None if gust is None else pytest.approx(gust))


def test_a_published_report_is_what_another_decoder_made_of_it(shared_data):
    known = json.loads((shared_data / "forecast" / "kjfk_metar.json").read_text())["data"]
    first, second = winds(known["raw"])  # two reports in one text
    assert first.station == known["station"]
    assert first.time_s == datetime.fromisoformat(known["time"]["dt"]).timestamp()
    assert first.speed_mps == pytest.approx(known["wind_speed"]["value"] * KNOT)
    assert first.from_deg == known["wind_direction"]["value"]
    assert (second.time_s, second.from_deg) == (first.time_s - 3600.0, 350.0)


def test_a_published_taf_is_no_observation(shared_data):
    taf = json.loads((shared_data / "forecast" / "kjfk_taf.json").read_text())["data"]["raw"]
    assert "is a TAF, a forecast" in refused(taf)


def test_reports_over_lines_with_dates_and_comments_are_read():
    text = "# fetched\n2023/09/30 23:51\nKEWR 302351Z 09010KT\n    10SM CLR\n\nMETAR KJFK 170551Z 09011KT=\n"
    first, second = winds(text)
    assert first.time_s == datetime(2023, 9, 30, 23, 51, tzinfo=UTC).timestamp()
    assert second.time_s == datetime(2023, 10, 17, 5, 51, tzinfo=UTC).timestamp()
    assert (first.line, second.line) == (3, 6)


def test_corrections_are_marked():
    assert [
        one.corrected for one in winds("KEWR 170551Z 09010KT\nMETAR COR KEWR 170551Z 09012KT\nKEWR 170551Z COR 09012KT")
    ] == [False, True, True]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("KEWR 170551Z 90010KT", "metar.txt:1: not a direction"),
        ("KEWR 170551Z 9010KT", "not a wind group"),
        ("KEWR 170551Z 09010MPH", "not a wind group"),
        ("KEWR 320551Z 09010KT", "no such day and time"),
        ("KEWR 172551Z 09010KT", "no such day and time"),
        ("<html>503</html>", "is not a METAR"),
        ("KEWR 1705Z 09010KT", "is not a METAR"),
        ("2023/13/40 05:51", "not a date"),
    ],
)
def test_what_is_no_report_is_a_clear_error(text, problem):
    assert problem in refused(text)


@given(
    station=st.from_regex(r"[A-Z][A-Z0-9]{3}", fullmatch=True),
    degrees=st.integers(0, 36),
    speed=st.integers(1, 140),
    gust=st.none() | st.integers(1, 150),
    unit=st.sampled_from([("KT", KNOT), ("MPS", 1.0), ("KMH", KMH), ("KTS", KNOT)]),
    stamp=st.datetimes(datetime(1990, 1, 1), datetime(2090, 1, 1)),  # noqa: DTZ001
    apart_d=st.floats(-13.0, 13.0),
)
def test_what_was_written_is_read_in_whatever_month(station, degrees, speed, gust, unit, stamp, apart_d):
    stamp = stamp.replace(second=0, microsecond=0, tzinfo=UTC)
    text = (
        f"{station} {stamp:%d%H%M}Z {10 * degrees:03d}{speed:02d}{'' if gust is None else f'G{gust:02d}'}{unit[0]} 9999"
    )
    if station in ("COR", "TAF") or "RMK" in station:
        return
    (one,) = winds(text, stamp.timestamp() + 86_400.0 * apart_d)
    assert (one.station, one.time_s, one.from_deg) == (station, stamp.timestamp(), 10.0 * degrees)
    assert one.speed_mps == pytest.approx(speed * unit[1])
    assert one.gust_mps == (None if gust is None else pytest.approx(gust * unit[1]))


@given(st.text(max_size=200))
def test_any_text_is_read_or_refused(text):
    parse_metars(text, NEAR, FaultCollector("metar.txt"))


def test_a_report_that_does_not_end_is_refused():
    assert "metar.txt:1: the report is too long" in refused("KEWR 170551Z 09010KT\n" + "  RMK\n" * 200_000)


def test_24_hours_is_the_end_of_the_day():
    assert nearest_s(31, 24, 0, NEAR + 86_400.0 * 14) == datetime(2023, 11, 1, tzinfo=UTC).timestamp()
    assert nearest_s(31, 24, 1, NEAR) is None
