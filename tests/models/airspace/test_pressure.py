"""Flight levels on a day: against the hydrostatic equation, integrated, and as they are handed over."""

import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.models.airspace.pressure import Pressure, resolved, split_pressure
from skyway.models.airspace.reading import read_airspace
from skyway.models.base.errors import InputError

GAS, GRAVITY = 287.052_87, 9.806_65
ZONE = "AC R\nAN Level\nAL FL 65\nAH FL 95\nDP 47:00:00 N 008:00:00 E\nDP 47:00:00 N 008:10:00 E\nDP 47:10:00 N 008:10:00 E\n"


def standard_hpa(height_m):
    return 1013.25 * (1.0 - 0.0065 * height_m / 288.15) ** (GRAVITY / (GAS * 0.0065))


def height_of(level_m, qnh, place_m, warmer_k, steps=400):
    """Where the pressure of a level is met in air that is warmer than the standard by the same at all heights."""
    k = GAS * 0.0065 / GRAVITY
    here = (qnh**k - 1013.25**k * 0.0065 * place_m / 288.15) ** (1.0 / k)
    wanted = math.log(standard_hpa(level_m))
    step = (math.log(here) - wanted) / steps
    height = place_m
    for _ in range(steps):  # dz = -(R T / g) d ln p, by the middle of each step
        middle = height + 0.5 * step * GAS * (288.15 - 0.0065 * height + warmer_k) / GRAVITY
        height += step * GAS * (288.15 - 0.0065 * middle + warmer_k) / GRAVITY
    return height


@settings(max_examples=40)
@given(
    level_m=st.floats(300.0, 9000.0),
    qnh=st.floats(960.0, 1080.0),
    share=st.floats(0.0, 1.0),
    warmer_k=st.floats(-35.0, 25.0),
)
def test_a_level_lies_in_its_band_wherever_the_station_is(level_m, qnh, share, warmer_k):
    place_m = share * min(0.9 * level_m, 4400.0)
    truth = height_of(level_m, qnh, place_m, warmer_k)
    degrees = 15.0 - 0.0065 * place_m + warmer_k
    told = Pressure((qnh, qnh), (degrees, degrees), sure=True).band_m(level_m)
    cold = Pressure((qnh, qnh), sure=True).band_m(level_m)
    for low, high in (told, cold, Pressure().band_m(level_m)):
        assert low - 1.0 <= truth <= high + 1.0


def test_a_known_day_leaves_a_level_within_what_may_change():
    low, high = Pressure((1013.25, 1013.25), (15.0, 15.0), sure=True).band_m(1000.0)
    assert 925.0 < low < 950.0
    assert 1050.0 < high < 1080.0
    low, high = Pressure((1030.0, 1030.0), (15.0, 15.0), sure=True).band_m(1000.0)
    assert low + high == pytest.approx(2.0 * (1000.0 + 16.75 * 8.25), abs=60.0)  # about 8.25 m for each hPa


@pytest.mark.parametrize(
    ("told", "hpa", "degrees"),
    [
        ("Q1021", 1021.0, None),
        ("1021.5", 1021.5, None),
        ("QNH998hPa", 998.0, None),
        ("A2992", 1013.2, None),
        ("29.92inHg", 1013.2, None),
        ("Q1021,-5C", 1021.0, -5.0),
    ],
)
def test_the_pressure_follows_the_name_of_the_file(tmp_path, told, hpa, degrees):
    path = tmp_path / "zones.txt"
    path.write_text(ZONE)
    file, found = split_pressure(tmp_path / f"zones.txt@{told}")
    assert file == path
    assert found.qnh_hpa == pytest.approx((hpa, hpa), abs=0.05)
    assert found.temperature_c == (None if degrees is None else (degrees, degrees))
    (zone,), _ = read_airspace([tmp_path / f"zones.txt@{told}"])
    assert zone.volumes[0].floor.lowest()[0] == pytest.approx(found.band_m(6500 * 0.3048)[0])
    assert zone.source == str(path)


def test_metars_tell_the_bounds_of_the_region(tmp_path):
    (tmp_path / "zones.txt").write_text(ZONE)
    reports = tmp_path / "metars.txt"
    reports.write_text(
        "METAR LSZH 231350Z 24010KT 9999 FEW040 04/M01 Q1019 NOSIG=\nSPECI KJFK 231351Z 22010KT 10SM CLR M02/M10 A2992 RMK AO2 SLP132\nLFSB 231400Z AUTO /////KT //// Q1016 TEMPO 30020KT\n"
    )
    _, found = split_pressure(tmp_path / f"zones.txt@metar={reports}")
    assert found.qnh_hpa == pytest.approx((1013.2, 1019.0), abs=0.05)
    assert found.temperature_c == (-2.0, 4.0)


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ("Q9999", "is impossible at sea level"),
        ("dry", "is not a pressure.*Q1013"),
        ("Q1013,x", "is not a pressure"),
        ("metar=none.txt", "none.txt"),
    ],
)
def test_what_is_no_pressure_is_one_clear_line(tmp_path, told, said):
    (tmp_path / "zones.txt").write_text(ZONE)
    with pytest.raises(InputError, match=said) as caught:
        read_airspace([tmp_path / f"zones.txt@{told}"])
    assert len(caught.value.faults) == 1


def test_names_are_found_from_anywhere(tmp_path, monkeypatch):
    (tmp_path / "zones.txt").write_text(ZONE)
    (tmp_path / "m.txt").write_text("KJFK 231351Z 22010KT 10SM CLR 24/18 A2992")
    monkeypatch.chdir(tmp_path)
    names = [resolved(Path(one)) for one in ("zones.txt", "zones.txt@Q1013", "zones.txt@metar=m.txt")]
    monkeypatch.chdir("/")
    assert [split_pressure(Path(one))[0] for one in names] == [tmp_path / "zones.txt"] * 3
    assert split_pressure(Path(names[2]))[1].qnh_hpa[0] == pytest.approx(1013.2, abs=0.05)


def test_reports_without_a_pressure_are_said(tmp_path):
    (tmp_path / "zones.txt").write_text(ZONE)
    (tmp_path / "m.txt").write_text("KJFK 231351Z 22010KT 10SM CLR")
    with pytest.raises(InputError, match="has no QNH"):
        split_pressure(tmp_path / f"zones.txt@metar={tmp_path / 'm.txt'}")
