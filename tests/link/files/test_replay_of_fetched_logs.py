"""``skyway replay`` leads from the recording of a flight to the logs that were fetched of it."""

import pytest
from drone_truth import fly
from log_factory import dataflash, multirotor, tlog

from skyway.cli.main import main
from skyway.link.files.catalog import NAME, logs_of, remember
from skyway.link.files.fetching import Fetched

FLIGHT = multirotor(fly(seed=5, duration_s=20.0))


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "flight.tlog"
    path.write_bytes(tlog(FLIGHT).data)
    return path


def fetched(recording, name, system=1):
    path = recording.with_name(name)
    path.write_bytes(dataflash(FLIGHT).data)
    remember(Fetched(path, path.stat().st_size, 0, True, 0, 0.0), system, [recording, recording.with_name("j.jsonl")])
    return path


def told(capsys, *words):
    code = main(["replay", *map(str, words)])
    found = capsys.readouterr()
    return code, found.out, found.err


def test_it_says_that_there_is_a_full_log_and_replays_it_when_asked(recording, capsys):
    full = fetched(recording, "vehicle1-1.bin")
    code, out, err = told(capsys, recording)
    assert (code, out.startswith("flight.tlog"), "--aboard" in err, full.name in err) == (0, True, True, True)
    recording.with_name("j.jsonl").write_text("")
    for named in (recording, recording.with_name("j.jsonl")):
        code, out, _ = told(capsys, named, "--aboard")
        assert (code, out.startswith(full.name)) == (0, True)


def test_of_several_one_is_named(recording, capsys):
    for number in (1, 2):
        fetched(recording, f"vehicle1-{number}.bin")
    code, _, err = told(capsys, recording, "--aboard")
    assert (code, "--aboard N: 1 vehicle1-1.bin, 2 vehicle1-2.bin" in err) == (2, True)
    code, out, _ = told(capsys, recording, "--aboard", 2)
    assert (code, out.startswith("vehicle1-2.bin")) == (0, True)
    code, _, err = told(capsys, recording, "--aboard", 3)
    assert (code, "no such log" in err) == (2, True)


def test_without_one_it_says_how_to_get_it(recording, capsys):
    code, _, err = told(capsys, recording, "--aboard")
    assert (code, "--fetch-log" in err, len(err.strip().splitlines())) == (2, True, 1)


def test_logs_of_another_vehicle_are_told_apart(recording, capsys):
    mine, other = fetched(recording, "vehicle1-1.bin"), fetched(recording, "vehicle2-1.bin", system=2)
    assert logs_of(recording) == [mine, other]
    assert logs_of(recording, 2) == [other]
    code, out, _ = told(capsys, recording, "--aboard", "--system", 2)
    assert (code, out.startswith(other.name)) == (0, True)


@pytest.mark.parametrize("name", ["../elsewhere.bin", "/etc/passwd", "gone.bin", "."])
def test_names_that_lead_elsewhere_or_nowhere_are_left_alone(recording, name):
    (recording.parent.parent / "elsewhere.bin").write_bytes(b"x")
    line = f'{{"log":"{name}","system":1,"size_bytes":1,"crc32":"0","recordings":["flight.tlog"]}}\n'
    recording.with_name(NAME).write_text(line + "{torn")
    assert logs_of(recording) == []


def test_a_recording_that_is_not_there_is_told(recording, capsys):
    code, _, err = told(capsys, recording.with_name("other.tlog"), "--aboard")
    assert (code, "other.tlog: no such file" in err) == (2, True)
