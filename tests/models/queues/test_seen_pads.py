"""Files of pads seen now, and hostile ones."""

import json

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.base.errors import InputError
from skyway.models.queues.pad_service import PadAnswer, StationStatus, encode
from skyway.models.queues.seen_pads import read_seen_pads

STATIONS = {"clinic": 0, "depot": 1}


def read(tmp_path, *lines):
    file = tmp_path / "pads.jsonl"
    file.write_text("\n".join(one if isinstance(one, str) else json.dumps(one) for one in lines))
    return read_seen_pads(file, STATIONS)


def test_a_line_says_how_many_drones_are_there(tmp_path):
    clinic, depot = read(
        tmp_path, "# seen 17:55", {"station": "clinic", "busy": 2}, "", {"station": "depot", "busy": 4, "waiting": 3}
    )
    assert (clinic.present, depot.present, clinic.remaining_s, clinic.posix_s) == (2, 7, (), None)


def test_what_a_pad_service_answers_is_read_as_it_came(tmp_path):
    status = StationStatus(
        station="clinic",
        posix_s=1e9,
        pads=5,
        busy=5,
        remaining_s=(60.0, 900.0),
        waiting=1,
        holding_spots=2,
        holding_free=1,
    )
    for line in (encode(PadAnswer(ok=True, station=status)), msgspec.json.encode(status)):
        (one,) = read(tmp_path, line.decode().strip())
        assert (one.present, one.pads, one.remaining_s, one.posix_s) == (6, 5, (60.0, 900.0), 1e9)


def test_the_last_line_of_a_station_counts(tmp_path):
    (one,) = read(tmp_path, {"station": "clinic", "busy": 2}, {"station": "clinic", "busy": 1})
    assert one.busy == 1


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ({"station": "clinic"}, "missing required field `busy`"),
        ({"station": "clinic", "busy": -1}, "is not a report of pads"),
        ({"station": "clinic", "busy": 1e9}, "is not a report of pads"),
        ({"station": "clinic", "busy": 2.5}, "is not a report of pads"),
        ({"station": "clnic", "busy": 1}, "no such station"),
        ({"station": "clinic", "busy": 3, "pads": 2}, "more than the 2 pads"),
        ({"station": "clinic", "busy": 1, "wating": 3}, "unknown field `wating`"),
        ({"station": "clinic", "busy": 1, "remaining_s": [1, 2]}, "2 times for 1 busy pads"),
        ({"station": "clinic", "busy": 1, "remaining_s": [-1]}, "is not a report of pads"),
        ({"station": "clinic", "busy": 1, "posix_s": 1e300}, "is not a time"),
        ({"ok": False, "error": "no station"}, "is not a report of pads"),
        ("[" * 100_000, "is not a report of pads"),
        ("clinic: 3", "is not a report of pads"),
    ],
)
def test_each_fault_names_its_line(tmp_path, line, problem):
    with pytest.raises(InputError) as error:
        read(tmp_path, {"station": "depot", "busy": 0}, line)
    assert "pads.jsonl:2" in str(error.value)
    assert problem in str(error.value)


def test_an_empty_file_says_what_would_be_right(tmp_path):
    with pytest.raises(InputError, match=r"reports no pads; a line for each station"):
        read(tmp_path, "")


@given(st.binary(max_size=300))
def test_any_file_is_read_or_refused(tmp_path_factory, content):
    file = tmp_path_factory.mktemp("any") / "pads.jsonl"
    file.write_bytes(content)
    with pytest.raises(InputError):
        read_seen_pads(file, STATIONS)
