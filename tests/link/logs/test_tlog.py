"""Telemetry logs are read to the last message, whatever lies between."""

import resource
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from tlog_factory import START_US, Recorder, counted_by_pymavlink, mixed_log

from skyway.link.logs.reader import open_log
from skyway.link.logs.tlog.tlog import ScanState, read_frames, scan
from skyway.models.base.errors import InputError

ROOT = Path(__file__).resolve().parents[3]

pytestmark = pytest.mark.filterwarnings("ignore")  # pymavlink's own


@pytest.mark.parametrize("name", ["cuav_quadplane_flight.tlog", "dronekit_copter_flight.tlog"])
def test_real_logs_hold_the_messages_that_pymavlink_counts(shared_data, name):
    index = scan(shared_data / "logs" / name)
    counts, bad = counted_by_pymavlink(shared_data / "logs" / name)
    assert index.by_type == counts
    assert index.bad_records == bad


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("garbage", [0.0, 0.05, 0.5])
def test_mixed_signed_logs_with_garbage_hold_the_messages_that_pymavlink_counts(tmp_path, seed, garbage):
    path = tmp_path / "flight.tlog"
    path.write_bytes(mixed_log(seed, 400, garbage=garbage))
    index = scan(path)
    assert (index.by_type, index.bad_records) == counted_by_pymavlink(path)


@pytest.mark.parametrize("seed", range(12))
def test_a_damaged_log_holds_the_messages_that_pymavlink_counts(tmp_path, seed):
    generator = np.random.default_rng(seed)
    data = np.frombuffer(mixed_log(seed, 300), dtype=np.uint8).copy()
    hit = generator.integers(0, len(data), 60)
    data[hit] = generator.integers(0, 256, 60)
    path = tmp_path / "flight.tlog"
    path.write_bytes(data.tobytes()[: len(data) - int(generator.integers(0, 80))])
    index = scan(path)
    assert (index.by_type, index.bad_records) == counted_by_pymavlink(path)


def test_noise_alone_ends_and_agrees_with_pymavlink(tmp_path):
    path = tmp_path / "noise.tlog"
    path.write_bytes(np.random.default_rng(1).integers(0, 256, 200_000, dtype=np.uint8).tobytes())
    index = scan(path)
    assert (index.by_type, index.bad_records) == counted_by_pymavlink(path)


@pytest.mark.parametrize("seed", range(4))
def test_noise_in_which_a_message_or_two_happen_to_be_valid_is_refused(tmp_path, seed):
    """A hundred kilobytes of random bytes were one message at the year 60895, and replayed."""
    path, rng = tmp_path / "noise.tlog", np.random.default_rng(seed)
    noise = rng.integers(0, 256, 100_000, dtype=np.uint8).tobytes()
    path.write_bytes(noise[:50_000] + bytes([90]) + mixed_log(seed, 1)[1:] + noise[50_000:])
    assert scan(path).messages > 0
    with pytest.raises(InputError, match="is not a flight log"):
        open_log(path)


@pytest.mark.parametrize("size", [0, 1, 7, 8, 9, 12, 20])
def test_an_empty_log_or_half_a_header_holds_nothing(tmp_path, size):
    path = tmp_path / "short.tlog"
    path.write_bytes(mixed_log(1, 3)[:size])
    assert scan(path).messages == 0


def test_chunks_of_any_size_give_the_same_messages(tmp_path):
    path = tmp_path / "flight.tlog"
    path.write_bytes(mixed_log(3, 8000, garbage=0.1))
    whole = scan(path)
    for chunk in (65_536, 70_001, 131_072):
        part = scan(path, chunk_bytes=chunk)
        assert (part.by_type, part.skipped_bytes) == (whole.by_type, whole.skipped_bytes)


def test_a_long_stretch_of_garbage_across_chunks_is_passed_over_as_pymavlink_does(tmp_path):
    path = tmp_path / "flight.tlog"
    data = mixed_log(3, 200)
    path.write_bytes(data + bytes(300_000) + data)
    index = scan(path, chunk_bytes=65_536)
    assert (index.by_type, index.bad_records) == counted_by_pymavlink(path)


def test_two_vehicles_in_one_log_are_told_apart(tmp_path):
    log = Recorder()
    for number in range(10):
        for system in (1, 7):
            log.add(number, log.dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3), system)
    path = tmp_path / "two.tlog"
    path.write_bytes(log.data)
    assert scan(path).by_system == {1: 10, 7: 10}


def test_fields_are_decoded_as_pymavlink_decodes_them(tmp_path):
    log = Recorder()
    sent = log.dialect.MAVLink_attitude_message(1234, 0.25, -0.5, 0.0, 0.0, 0.0, 0.0)
    for first, signed in ((True, False), (False, False), (False, True)):
        log.add(1.5, sent, first_version=first, signed=signed)
    path = tmp_path / "one.tlog"
    path.write_bytes(log.data)
    (frames,) = read_frames(path)
    fields = frames.decoded("ATTITUDE", frames.rows_of("ATTITUDE"))
    assert fields["roll"].tolist() == [0.25] * 3
    assert fields["pitch"].tolist() == [-0.5] * 3
    assert fields["time_boot_ms"].tolist() == [1234] * 3
    assert frames.time_s == pytest.approx([START_US / 1e6 + 1.5] * 3)


def test_reading_can_begin_at_any_seek_point(tmp_path):
    path = tmp_path / "flight.tlog"
    path.write_bytes(mixed_log(5, 20_000))
    index = scan(path)
    at = START_US / 1e6 + 200.0
    times = np.concatenate([frames.time_s for frames in read_frames(path, begin=index.offset_at(at)[0])])
    assert times[0] < at < times[0] + 60.0
    every = np.concatenate([frames.time_s for frames in read_frames(path)])
    assert (times >= at).sum() == (every >= at).sum()


def test_a_missing_file_or_a_folder_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        scan(tmp_path / "none.tlog")
    with pytest.raises(InputError, match="cannot be read"):
        scan(tmp_path)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_log(tmp_path):
    unit = mixed_log(7, 20_000)

    def peak_mb(repeat: int) -> float:
        path = tmp_path / "big.tlog"
        with path.open("wb") as stream:
            for _ in range(repeat):
                stream.write(unit)
        script = textwrap.dedent(f"""
            from pathlib import Path
            from benchmarks.tables.memory import peak_memory_mb
            from skyway.link.logs.tlog.tlog import scan
            scan(Path({str(path)!r}))
            print(peak_memory_mb())
        """)
        answer = subprocess.run([sys.executable, "-c", script], cwd=ROOT, check=True, capture_output=True, text=True)
        return float(answer.stdout)

    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss > 0
    small, large = peak_mb(10), peak_mb(500)
    assert large < small + 20
    assert large < 300


def test_the_parser_says_what_it_skipped(tmp_path):
    path = tmp_path / "flight.tlog"
    data = mixed_log(1, 50)
    path.write_bytes(data + b"\x00" * 8 + b"rubbish")
    memory = ScanState()
    assert sum(len(frames) for frames in read_frames(path, memory=memory)) == 50
    assert scan(path).skipped_bytes == 7
