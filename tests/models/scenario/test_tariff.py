"""Prices of a scenario: from four places, and what is wrong with them."""

import gzip
from datetime import datetime

import numpy as np
import pytest

from skyway.models.base.errors import InputError
from skyway.models.scenario.file import read_scenario
from skyway.models.scenario.tariff import Tariff

TOML = """schema = "skyway.scenario/1"
timezone = "Europe/Berlin"
[network]
stations = "stations.csv"
max_length_m = 20000
[costs]
currency = "EUR"
energy_price_per_kwh = 0.3
pad_fee = 0.5
"""
STATIONS = """id,lat,lon,energy_price_per_kwh,pad_fee
a,52.50,13.40,,
b,52.55,13.40,0.4,
c,52.60,13.40,0,2
"""


def written(folder, toml=TOML, stations=STATIONS, **files):
    (folder / "scenario.toml").write_text(toml)
    (folder / "stations.csv").write_text(stations)
    for name, text in files.items():
        (folder / f"{name}.csv").write_text(text)
    return folder


def test_usual_price_station_and_hour(tmp_path):
    """A row by the hour goes before the station's column, that before the usual price."""
    rows = "station,hour_of_week,price_per_kwh\nb,17,0.9\n*,18,0.7\n"
    tariff = read_scenario(written(tmp_path, TOML + 'prices = "p.csv"\n', p=rows)).tariff
    assert tariff.energy_per_kwh[:, 0].tolist() == [0.3, 0.4, 0.0]
    assert tariff.energy_per_kwh[:, 17].tolist() == [0.3, 0.9, 0.0]
    assert tariff.energy_per_kwh[:, 18].tolist() == [0.7, 0.7, 0.7]
    assert tariff.pad_fee.tolist() == [0.5, 0.5, 2.0]
    assert (tariff.currency, tariff.refill_per_kwh, tariff.by_hour) == ("EUR", 0.3, True)
    longer = tariff.of_length(5)
    assert longer.energy_per_kwh[3:, 3].tolist() == [0.3, 0.3]
    assert longer.pad_fee[3:].tolist() == [0.0, 0.0]


def test_record_is_averaged_by_hour_of_the_week(tmp_path):
    """Two Mondays, one column that is no station, one gap."""
    rows = "time,c,a,x\n2024-01-01 05:00,0.2,0.5,1\n2024-01-08 05:00,0.4,,1\n2024-01-08 06:00,0.6,0.5,1\n"
    found = read_scenario(written(tmp_path, TOML + 'price_record = "p.csv"\n', p=rows))
    prices = found.tariff.energy_per_kwh
    assert prices[2, 5] == pytest.approx(0.3)
    assert prices[2, 6] == pytest.approx(0.6)
    assert prices[2, 100] == pytest.approx(0.4)
    assert prices[0] == pytest.approx(0.5)
    assert (prices[1] == 0.4).all()
    assert any("1 columns are not stations" in one for one in found.warnings)


@pytest.mark.parametrize(
    ("toml", "stations", "rows", "words"),
    [
        (TOML.replace('currency = "EUR"\n', ""), STATIONS, None, "costs.currency: is missing"),
        (TOML.replace("0.3", "-0.3"), STATIONS, None, "costs.energy_price_per_kwh: out of range"),
        (TOML + "fee = 1\n", STATIONS, None, "costs.fee: is not a field here"),
        (TOML, STATIONS.replace("0.4", "cheap"), None, "stations.csv:3: energy_price_per_kwh: is not a number"),
        (TOML, STATIONS.replace(",2\n", ",-2\n"), None, "stations.csv:4: pad_fee: out of range"),
        (TOML + 'prices = "p.csv"\n', STATIONS, "b,17,0.9\nb,17,0.8\n", "p.csv:3: hour_of_week: second row for station b"),
        (TOML + 'prices = "p.csv"\n', STATIONS, "d,17,0.9\n", "p.csv:2: station: no such station"),
        (TOML + 'prices = "p.csv"\n', STATIONS, "b,168,0.9\n", "p.csv:2: hour_of_week: not an hour of the week"),
        (TOML + 'prices = "p.csv"\n', STATIONS, "b,0,nan\n", "p.csv:2: price_per_kwh: not a price"),
        (TOML + 'prices = "q.csv"\n', STATIONS, None, "costs.prices: no such file"),
        (TOML + 'prices = "p.csv"\nprice_record = "p.csv"\n', STATIONS, "b,0,1\n", "are both given"),
    ],
)  # fmt: skip
def test_faults_are_named(tmp_path, toml, stations, rows, words):
    """File, line or field, and value."""
    files = {} if rows is None else {"p": "station,hour_of_week,price_per_kwh\n" + rows}
    with pytest.raises(InputError) as error:
        read_scenario(written(tmp_path, toml, stations, **files))
    assert words in str(error.value)


def test_prices_of_python_objects_are_checked():
    """What a caller puts together himself."""
    with pytest.raises(InputError, match="shapes"):
        Tariff("EUR", np.zeros((2, 24)), np.zeros(2), 0.0, "UTC")
    with pytest.raises(InputError, match="is not a price"):
        Tariff("EUR", np.full((2, 168), np.nan), np.zeros(2), 0.0, "UTC")


def test_melbourne(shared_data, tmp_path):
    """A record that nobody here wrote: charging prices of Melbourne, 2023, by station and hour."""
    shared = shared_data / "stations"
    ids = (shared / "melbourne_stations.csv").read_text().splitlines()
    toml = f"""schema = "skyway.scenario/1"
timezone = "Australia/Melbourne"
[network]
stations = "{(shared / "melbourne_stations.csv").as_posix()}"
max_length_m = 15000
[network.columns]
id = "station_id"
lat = "latitude"
lon = "longitude"
[costs]
currency = "AUD"
energy_price_per_kwh = 0.3
price_record = "{(shared / "melbourne_e_price.csv.gz").as_posix()}"
"""
    (tmp_path / "scenario.toml").write_text(toml)
    found = read_scenario(tmp_path)
    assert len(found.network) == len(ids) - 1
    # station 11 at Mondays 08:00 by hand, by name, not by position
    with gzip.open(shared / "melbourne_e_price.csv.gz", "rt") as stream:
        header, *rows = stream.read().splitlines()
    column = header.split(",").index("11")
    values = [
        float(row.split(",")[column])
        for row in rows
        if (when := datetime.fromisoformat(row.split(",")[0])).weekday() == 0 and when.hour == 8
    ]
    node = found.network.index["11"]
    assert found.tariff.energy_per_kwh[node, 8] == pytest.approx(np.mean(values))
