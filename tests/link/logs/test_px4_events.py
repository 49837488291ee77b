"""PX4's events are told in the words of the log's own metadata; those that nobody describes by number and arguments."""

import json
import lzma
import struct

import pytest
from drone_truth import fly
from log_factory import multirotor, ulog

from skyway.link.logs.reader import open_log
from skyway.link.logs.ulog.px4_events import EventWords, number_of

FLIGHT = multirotor(fly(seed=3, duration_s=30.0))
UNKNOWN = 1 << 24 | 4711
KINDS = {
    "check_gps_gone": {
        "message": "GPS {3} gone\\<!",
        "arguments": [{"type": "modes_t"}, {"type": "uint8_t"}, {"type": "int8_t"}],
    },
    "far_away": {
        "message": "<param>NAV_X</param>: {1:.1m_v} above, {2m} off, {3}, {4}",
        "arguments": [{"type": "float"}, {"type": "int32_t"}, {"type": "px4::modes_t"}, {"type": "px4::why_t"}],
    },
    "commander_arming_check_summary": {"message": "begin", "type": "summary"},
    "commander_health_summary": {"message": "end", "type": "summary"},
}
ENUMS = {
    "modes_t": {
        "type": "uint16_t",
        "is_bitfield": True,
        "entries": {"1": {"name": "one", "description": "One"}, "8": {"name": "eight", "description": "Eight"}},
    },
    "why_t": {"type": "uint8_t", "entries": {"3": {"name": "because", "description": ""}}},
}


def metadata():
    def group(*names):
        return {"events": {str(number_of(name) & 0xFFFFFF): {"name": name, **KINDS[name]} for name in names}}

    groups = {
        "arming_check": group("check_gps_gone", "commander_arming_check_summary"),
        "health": group("commander_health_summary"),
        "default": group("far_away"),
    }
    told = {"version": 2, "components": {"1": {"namespace": "px4", "enums": ENUMS, "event_groups": groups}}}
    return lzma.compress(json.dumps(told).encode(), preset=9)


def flight(tmp_path, happened, packed=b"", texts=()):
    """A log with events (second, number, packed arguments), and metadata in parts."""
    log = ulog(FLIGHT)
    key = b"uint8_t[1] metadata_events"
    parts = [
        log._message("M", bytes([begin > 0, len(key)]) + key + packed[begin : begin + 100])
        for begin in range(0, len(packed), 100)
    ]
    form = b"event:uint64_t timestamp;uint32_t id;uint16_t event_sequence;uint8_t[25] arguments;uint8_t log_levels;"
    log.parts[1:1] = [*parts, log._message("F", form)]
    log.parts.append(log._message("A", struct.pack("<BH", 0, 99) + b"event"))
    for second, number, arguments in happened:
        body = struct.pack("<HQIH", 99, round(1e6 * second), number, 0) + arguments.ljust(25, b"\0") + b"\0"
        log.parts.append(log._message("D", body))
    for second, text in texts:
        log.text(second, text)
    path = tmp_path / "flight.ulg"
    path.write_bytes(log.data)
    summary = open_log(path).summary
    return [(round(event.time_s, 2), event.text) for event in summary.events]


def test_the_events_of_a_real_flight_are_told_in_the_words_of_its_own_metadata(shared_data):
    summary = open_log(shared_data / "logs" / "flugdrohne_20230621_log66.ulg").summary
    told = [event.text for event in summary.events]
    for text in (
        "check failed: No valid global position estimate",
        "Armed by RC",
        "Takeoff detected",
        "Executing Mission",
        "Takeoff to 35.0 m above home",  # its own text: Takeoff to 35.0 meters above home
        "Disarmed by RC",
    ):
        assert told.count(text) == (2 if text == "Takeoff detected" else 1), text
    assert not any("not described" in text or "summary" in text.lower() for text in told)


def test_the_number_of_every_event_of_px4_is_made_of_its_name(shared_data):
    pyulog = pytest.importorskip("pyulog")
    log = pyulog.ULog(str(shared_data / "logs" / "flugdrohne_20230621_log66.ulg"))
    told = json.loads(
        lzma.decompress(b"".join(bytes(part) for part in log.msg_info_multiple_dict["metadata_events"][0]))
    )
    names = {
        int(number): kind["name"]
        for group in told["components"]["1"]["event_groups"].values()
        for number, kind in group["events"].items()
    }
    assert len(names) > 300
    assert all(number_of(name) == 1 << 24 | number for number, name in names.items())


def test_what_is_known_without_metadata_says_what_the_metadata_of_a_real_log_say(shared_data):
    pyulog = pytest.importorskip("pyulog")
    log = pyulog.ULog(str(shared_data / "logs" / "flugdrohne_20230621_log66.ulg"))
    packed = b"".join(bytes(part) for part in log.msg_info_multiple_dict["metadata_events"][0])
    own, theirs = EventWords(), EventWords(packed)
    assert theirs._known.keys() - own._known.keys(), "the log describes its events"
    arguments = struct.pack("<IBHB", 0, 5, 5, 3).ljust(25, b"\1")
    same = [number for number in own._known if theirs.describes(number)]
    assert len(same) > 20
    for number in same:
        assert own.is_summary(number) == theirs.is_summary(number)
        if not own.is_summary(number):
            assert own.text(number, arguments) == theirs.text(number, arguments)


def test_a_refused_arming_and_a_failsafe_are_told_without_metadata(tmp_path):
    happened = [
        (3.0, number_of("commander_arm_denied_throttle_high"), b""),
        (4.0, number_of("commander_armed_by"), b"\4"),
        (9.0, number_of("commander_failsafe_enter"), struct.pack("<IBB", 0, 6, 4)),
        (9.5, UNKNOWN, b"\1\0\7"),
        (9.6, UNKNOWN + 1, b""),
    ]
    told = flight(tmp_path, happened)
    assert (3.0, "Arming denied: high throttle") in told
    assert (4.0, "Armed by external command") in told
    assert (9.0, "Failsafe activated due to critical battery level, triggering RTL") in told
    assert (9.5, "event 1:4711, not described in the log, arguments 01 00 07") in told
    assert (9.6, "event 1:4712, not described in the log") in told


def test_a_lasting_check_is_told_when_it_begins_and_when_it_comes_back(tmp_path):
    begin, end = number_of("commander_arming_check_summary"), number_of("commander_health_summary")
    check, other = (number_of("check_gps_gone"), b"\1\0\0\2"), (UNKNOWN, b"\1")
    happened = []
    for second, lines in ((3.0, [check]), (4.0, [check, other]), (5.0, [other]), (6.0, [check])):
        happened += [(second, begin, b""), *((second, *line) for line in lines), (second, end, b"")]
    told = flight(tmp_path, happened, metadata())
    assert [second for second, text in told if text == "check failed: GPS 2 gone<!"] == [3.0, 6.0]
    assert [second for second, text in told if "1:4711" in text] == [4.0]
    assert not any(text in ("begin", "end") for _, text in told)


def test_numbers_units_bits_and_tags_stand_in_the_message(tmp_path):
    arguments = struct.pack("<fiHB", 12.34, 17, 9, 3)
    told = flight(tmp_path, [(3.0, number_of("far_away"), arguments)], metadata())
    assert (3.0, "NAV_X: 12.3 m above, 17 m off, One|Eight, because") in told


def test_a_text_that_stands_for_an_event_is_left_out_only_where_the_event_is_told(tmp_path):
    texts = [(3.0, "[commander] Takeoff detected\t"), (5.0, "[x] Something else\t"), (7.0, "[commander] Plain")]
    told = flight(tmp_path, [(3.0, number_of("commander_takeoff_detected"), b""), (5.0, UNKNOWN, b"")], texts=texts)
    said = [text for _, text in told]
    assert "Takeoff detected" in said
    assert "[commander] Takeoff detected" not in said
    assert "[x] Something else" in said
    assert "[commander] Plain" in said


@pytest.mark.parametrize(
    "packed",
    [
        b"no XZ at all",
        metadata()[:-40],
        metadata()[:50] + b"\xff" * 20 + metadata()[70:],
        lzma.compress(b'{"components": {"1": {"event_groups": 7}}}'),
        lzma.compress(b"[" * 100_000),
        lzma.compress(b" " * (9 << 20)),
    ],
    ids=["text", "cut", "damaged", "other form", "nested", "too large"],
)
def test_damaged_metadata_are_as_none(tmp_path, packed):
    told = flight(
        tmp_path, [(3.0, number_of("commander_armed_by"), b"\1"), (4.0, number_of("far_away"), b"\1")], packed
    )
    assert (3.0, "Armed by RC") in told
    assert any("not described in the log, arguments 01" in text for _, text in told)
