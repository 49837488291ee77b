"""Damaged files: an `InputError` or a mission, never anything else, and never for long."""

import json
import random
import re
import tracemalloc

import pytest

from skyway.missions import check, family_named
from skyway.missions.files import mission_file, plan_writer, waypoints_file
from skyway.missions.files.dropped import dropped
from skyway.models.base.errors import InputError
from skyway.models.base.json_text import json_text

SEED = 20131
SNIPPETS = (
    *(b"\x00", b"\xff", b"{", b"}", b"[", b"]", b"null", b"-1", b"1e999", b"NaN", b"nan", b"inf", b"0", b"\t", b"\n"),
    *(b"177", b"99999999999999999999", b'"', b",", b"true", b"RALLY", b"QGC WPL 110\n", b"5001", b"-0.0", b"\xc3\xa9"),
    *(b'"params": []', b'"type": "ComplexItem"', b"224", b"600", b"601", b"1e38", b"#", b"\r\n", b"[[[[[[[["),
)

NUMBERS = (
    *(b"0", b"1", b"-1", b"2", b"3", b"10", b"16", b"17", b"18", b"19", b"20", b"21", b"22", b"31", b"82", b"93"),
    *(b"177", b"178", b"189", b"211", b"224", b"400", b"600", b"601", b"5001", b"5003", b"5100", b"31014"),
    *(b"-0.0", b"0.5", b"89.9999999", b"-179.9999999", b"3.4e38", b"1e-300", b"65535", b"4294967295", b"1e18"),
)


def mutated(data, random_source):
    """One to six changed numbers, or cuts, doublings, swaps, insertions and flipped bytes."""
    if random_source.random() < 0.5:
        return renumbered(data, random_source)
    data = bytearray(data)
    for _ in range(random_source.randint(1, 6)):
        if not data:
            break
        at = random_source.randrange(len(data))
        end = min(len(data), at + random_source.choice((1, 2, 8, 40, 400)))
        kind = random_source.randrange(6)
        if kind == 0:
            del data[at:end]
        elif kind == 1:
            data[at:at] = data[at:end]
        elif kind == 2:
            data[at] = random_source.randrange(256)
        elif kind == 3:
            data[at:at] = random_source.choice(SNIPPETS)
        elif kind == 4:
            data[at:end] = random_source.choice(SNIPPETS)
        else:
            other = random_source.randrange(len(data))
            data[at], data[other] = data[other], data[at]
    return bytes(data)


def renumbered(data, random_source):
    """One to six numbers replaced by others: the form stays whole, the mission becomes nonsense."""
    for _ in range(random_source.randint(1, 6)):
        found = list(re.finditer(rb"-?\d+(\.\d+)?", data))
        if not found:
            break
        match = random_source.choice(found)
        data = data[: match.start()] + random_source.choice(NUMBERS) + data[match.end() :]
    return data


def survives(data):
    """Read, check and write; return whether it could be read."""
    try:
        document = mission_file.loads(data, "fuzz")
    except InputError:
        return False
    report = check(document)
    assert len(report.findings) < 2000
    json_text(report)
    mission_file.loads(plan_writer.dumps(document).encode())
    mission_file.loads(waypoints_file.dumps_mission(document).encode())
    return True


def fuzz(folder, count):
    """Feed that many damaged files; return how many could be read."""
    sources = [path.read_bytes() for path in sorted(folder.iterdir()) if path.name != "README.md"]
    random_source = random.Random(SEED)
    read = 0
    for number in range(count):
        data = mutated(sources[number % len(sources)], random_source)
        read += survives(data)
    return read


@pytest.mark.parametrize("count", [2000, pytest.param(10_000, marks=pytest.mark.slow)])
def test_thousands_of_damaged_files_are_read_or_refused(shared_data, count):
    read = fuzz(shared_data / "missions", count)
    assert 0.1 * count < read < 0.9 * count


@pytest.mark.slow
def test_damaged_files_do_not_fill_the_memory(shared_data):
    tracemalloc.start()
    try:
        fuzz(shared_data / "missions", 1000)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 100e6


@pytest.mark.parametrize(
    "data",
    [
        b"{" * 100_000,
        b'{"mission":' * 50_000,
        b"QGC WPL 110\n" + b"0 0 0 177 0 -1 0 0 0 0 0 1\n" * 3000,
        b'{"fileType":"Plan","mission":{"items":' + b"[" * 900 + b"]" * 900 + b"}}",
        b"QGC WPL 110\n" + b"9" * 5000 + b" 0 0 16 0 0 0 0 0 0 0 1\n",
        b"QGC WPL 110\n0 0 0 16 0 0 0 0 " + b"1" * 400 + b" 0 0 1\n",
    ],
    ids=["braces", "nesting", "jumps", "lists", "digits", "long number"],
)
def test_files_made_to_hurt_end_in_one_error(data):
    survives(data)


PLAN = b'{"fileType": "Plan", "mission": {"version": 2, "items": [{"command": 20, "frame": 2, "params": [0, 0, 0, 0, 0, 0, 0]}]}}'
ROWS = b"QGC WPL 110\n0 1 0 16 0 0 0 0 47.5 8.5 400 1\n1 0 3 20 0 0 0 0 0 0 0 1\n"
FENCE = b"47.5 8.5\n47.4 8.4\n47.4 8.6\n47.6 8.6\n47.4 8.4\n"


@pytest.mark.parametrize("data", [PLAN, ROWS, FENCE], ids=["plan", "waypoints", "fence"])
def test_line_ends_and_a_mark_of_utf_8_change_nothing_and_other_encodings_are_named(data):
    plain = mission_file.loads(data)
    for same in (b"\xef\xbb\xbf" + data, data.replace(b"\n", b"\r\n"), data.replace(b"\n", b"\r"), data.rstrip()):
        assert mission_file.loads(same) == plain
    for encoding in ("utf-16", "utf-16-le", "utf-16-be", "utf-32"):
        with pytest.raises(InputError, match=r"is not UTF-8 text.*save it as UTF-8"):
            mission_file.loads(data.decode().encode(encoding), "some.file")


def strange_plan(value):
    """Return a plan that says this value wherever a reader might take it unasked."""
    item = {"command": 16, "frame": 3, "params": [0, 0, 0, 0, 47.5, 8.5, 50]}
    keys = (
        "comment",
        "Altitude",
        "AltitudeMode",
        "AMSLAltAboveTerrain",
        "claimedVertexCount",
        "skywayUnknown",
        "circle",
    )
    strange = dict.fromkeys(keys, value)
    polygon = {"inclusion": True, "polygon": [[47, 8], [47, 9], [48, 9]]}
    circle = {"inclusion": True, "circle": {**strange, "center": [47, 8], "radius": 5}}
    fence = {**strange, "version": 2, "polygons": [{**strange, **polygon}], "circles": [{**strange, **circle}]}
    mission = {**strange, "version": 2, "items": [{**strange, **item}], "globalPlanAltitudeMode": value}
    rally = {**strange, "version": 2, "points": [[47, 8, 5]]}
    return {**strange, "fileType": "Plan", "mission": mission, "geoFence": fence, "rallyPoints": rally}


@pytest.mark.parametrize("value", ["x", None, 5, 10**400, -1e300, [1], {"a": 1}, True], ids=lambda v: str(v)[:6])
def test_strange_values_of_keys_that_are_only_kept_do_no_harm(value):
    plan = strange_plan(value)
    if value is not None and value != 5:
        with pytest.raises(InputError, match=r"polygons\[0\].claimedVertexCount: is"):
            mission_file.loads(json.dumps(plan).encode(), "strange.plan")
        del plan["geoFence"]["polygons"][0]["claimedVertexCount"]
    document = mission_file.loads(json.dumps(plan).encode(), "strange.plan")
    for autopilot in ("px4", "ardupilot"):
        json_text(check(document, dialect=family_named(autopilot)))
    assert mission_file.loads(plan_writer.dumps(document).encode()) == document
    assert dropped(document, ".plan") is not None
    assert dropped(document, ".waypoints")
