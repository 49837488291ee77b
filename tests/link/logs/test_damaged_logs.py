"""Damaged logs hold what the makers' own readers count in them, and give telemetry in the order of time, or one error."""

import contextlib
import io
import struct
from collections import Counter

import numpy as np
import pytest
from drone_truth import fly
from log_factory import dataflash, multirotor, plane, tlog, ulog
from tlog_factory import START_US, counted_by_pymavlink, mixed_log

from skyway.link.logs.reader import format_of, open_log
from skyway.link.logs.tlog.stamps import StampCheck
from skyway.models.base.errors import InputError

pytestmark = pytest.mark.filterwarnings("ignore")  # pymavlink's and pyulog's own
KINDS = (
    "cut end",
    "cut front",
    "cut middle",
    "flips",
    "garbage",
    "duplicate",
    "absurd",
    "stamps",
    "zeros",
    "cut twice",
)
FORMATS = ("tlog", "bin", "ulg")


def damaged(data, kind, generator):
    """A copy of a log with one kind of damage, of any size and at any place."""
    whole, size = bytearray(data), len(data)

    def anywhere(least=0, most=None):
        return int(generator.integers(least, size if most is None else most))

    if kind == "cut end":
        return bytes(whole[: anywhere(size // 10)])
    if kind == "cut front":
        return bytes(whole[anywhere(1, 2000) :])
    if kind == "cut middle":
        begin = anywhere(100, size - 3000)
        return bytes(whole[:begin] + whole[begin + anywhere(1, 2500) :])
    if kind == "flips":
        for at in generator.integers(0, size, int(generator.integers(1, 100))).tolist():
            whole[at] ^= 1 << int(generator.integers(8))
    elif kind == "garbage":
        for _ in range(int(generator.integers(1, 12))):
            at = anywhere()
            whole[at:at] = generator.integers(0, 256, int(generator.integers(1, 400)), dtype=np.uint8).tobytes()
    elif kind == "duplicate":
        begin, length = anywhere(0, size - 9000), anywhere(100, 8000)
        whole[begin:begin] = whole[begin : begin + length]
    elif kind == "absurd":
        for at in generator.integers(0, size - 8, 20).tolist():
            whole[at : at + 4] = struct.pack("<f", [-3e38, 3e38, np.nan, np.inf][int(generator.integers(4))])
    elif kind == "stamps":
        for at in [0, *generator.integers(0, size - 8, 5).tolist()]:
            whole[at : at + 8] = generator.integers(0, 256, 8, dtype=np.uint8).tobytes()
    elif kind == "zeros":
        begin = anywhere(0, size - 3000)
        whole[begin : begin + 2000] = bytes(len(whole[begin : begin + 2000]))
    else:
        begin, middle, end = anywhere(1, 3000), anywhere(size // 4, size // 2), anywhere(size // 2, size)
        return bytes(whole[begin:middle] + whole[middle + anywhere(1, 300) : end])
    return bytes(whole)


class Bounded(io.BytesIO):
    """A file that ends a reader which never comes back."""

    reads = 0

    def read(self, *arguments):
        self.reads += 1
        if self.reads > 400_000:
            raise TimeoutError
        return super().read(*arguments)


def counted(path, form):
    """Messages by type as the maker's own reader counts them; None where it refuses the log or never comes back."""
    counts = Counter()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        if form == "tlog":
            return counted_by_pymavlink(path)[0]
        if form == "bin":
            from pymavlink.DFReader import DFReader_binary

            try:
                log = DFReader_binary(str(path))
            except Exception as error:
                if "Unsupported format char" in str(error):
                    return (
                        None  # one damaged letter of a format ends pymavlink's reading; we go on (decision record 66)
                    )
                raise
            while (message := log.recv_msg()) is not None:
                counts[message.get_type()] += 1
            log.filehandle.close()
            return dict(counts)
        from pyulog import ULog
        from pyulog.core import ULogException

        try:
            for part in ULog(Bounded(path.read_bytes())).data_list:
                if "timestamp" not in part.data:
                    return None  # a damaged name of that field ends pyulog's reading; we go on (decision record 66)
                counts[part.name] += len(part.data["timestamp"])
        except (ULogException, TimeoutError):
            return None
        return dict(counts)


def agrees(path, form):
    """Compare, and read what telemetry there is."""
    theirs = counted(path, form)
    try:
        log = open_log(path)
    except InputError:
        assert not theirs
        return
    if theirs is not None:
        assert log.summary.by_type == theirs
    latest = {}
    for track in log.tracks():
        assert (np.diff(track.time_s) >= 0.0).all()
        assert track.time_s[0] >= latest.get(track.system, -np.inf)
        latest[track.system] = track.time_s[-1]
        assert not np.isinf(track.values).any()


REAL = {
    "cuav_quadplane_flight.tlog": 60_000,
    "dronekit_copter_flight.tlog": 60_000,
    "erle_copter_auto_20141205.BIN": 60_000,
    "flugdrohne_20230621_log66.ulg": 260_000,
    "pyulog_sample_log_small.ulg": 120_000,
}
FLIGHT = multirotor(fly(seed=1, duration_s=30.0))
MADE = {
    "mixed.tlog": lambda: mixed_log(2, 800),
    "plane.tlog": lambda: tlog(plane(duration_s=30.0), 1).data,
    "copter.bin": lambda: dataflash(FLIGHT, parameters={"FRAME_CLASS": 1.0}, modes=lambda row: row // 100).data,
    "copter.ulg": lambda: ulog(FLIGHT).data,
}


@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_real_log_holds_what_its_makers_reader_counts(shared_data, tmp_path, name, kind):
    data = (shared_data / "logs" / name).read_bytes()[: REAL[name]]
    path = tmp_path / f"log.{name.rsplit('.')[-1].lower()}"
    path.write_bytes(damaged(data, kind, np.random.default_rng(KINDS.index(kind))))
    agrees(path, path.suffix[1:])


@pytest.mark.slow
@pytest.mark.parametrize("name", [*REAL, *MADE])
@pytest.mark.parametrize("kind", KINDS)
def test_five_hundred_damaged_logs_hold_what_their_makers_readers_count(shared_data, tmp_path, name, kind):
    data = MADE[name]() if name in MADE else (shared_data / "logs" / name).read_bytes()[: 4 * REAL[name]]
    path = tmp_path / f"log.{name.rsplit('.')[-1].lower()}"
    for seed in range(6):
        path.write_bytes(damaged(data, kind, np.random.default_rng([seed, KINDS.index(kind), len(name)])))
        agrees(path, path.suffix[1:])


@pytest.mark.parametrize("cut", [1, 7, 8, 9, 333, 1999])
def test_a_tlog_whose_first_bytes_are_cut_is_found_again_at_the_next_frame(shared_data, tmp_path, cut):
    data = (shared_data / "logs" / "cuav_quadplane_flight.tlog").read_bytes()[:200_000]
    path = tmp_path / "cut.tlog"
    path.write_bytes(data)
    whole = open_log(path).summary
    path.write_bytes(data[cut:])
    part = open_log(path).summary
    assert part.messages > whole.messages - 60
    assert part.end_s == pytest.approx(whole.end_s)
    assert 0.0 <= part.start_s - whole.start_s < 5.0
    named_otherwise = tmp_path / "cut.dat"
    named_otherwise.write_bytes(data[cut:])
    assert format_of(named_otherwise) == "tlog"


@pytest.mark.parametrize("wrong_s", [30.0, 3600.0, 86_400.0, 40 * 86_400.0, -30.0, -3600.0, -40 * 86_400.0, -1.6e9])
def test_one_wrong_first_stamp_does_not_shift_a_log(tmp_path, wrong_s):
    data = bytearray(mixed_log(4, 2000))
    path = tmp_path / "flight.tlog"
    path.write_bytes(bytes(data))
    whole = open_log(path).summary
    data[:8] = struct.pack(">Q", START_US + round(wrong_s * 1e6))
    path.write_bytes(bytes(data))
    found = open_log(path).summary
    assert found.messages == whole.messages
    assert found.start_s == pytest.approx(whole.start_s, abs=0.2)
    assert found.end_s == pytest.approx(whole.end_s, abs=0.001)
    assert any(
        "1 time stamp far from its neighbours; the time before is used instead" in doubt
        for doubt in found.time_base.doubts
    )


@pytest.mark.parametrize("wrong_s", [20.0, -20.0, 3600.0, -3600.0])
@pytest.mark.parametrize("row", [1, 500, 998, 999, 1000, 1001])
def test_one_wrong_stamp_anywhere_shifts_nothing_behind_it(row, wrong_s):
    """Chunks of a thousand: at their edges too."""
    time_s = 1.7e9 + 0.1 * np.arange(2000)
    wrong = time_s.copy()
    wrong[row] += wrong_s
    check = StampCheck()
    times = np.concatenate([check.clean(wrong[:1000]), check.clean(wrong[1000:])])
    assert check.disbelieved >= 1
    assert times[-1] == pytest.approx(time_s[-1], abs=0.2)
    assert (np.diff(times) >= 0.0).all()


@pytest.mark.parametrize("form", ["bin", "ulg"])
def test_one_wrong_time_in_an_autopilots_log_loses_that_message_only(tmp_path, form):
    log = dataflash(FLIGHT) if form == "bin" else ulog(FLIGHT)
    path = tmp_path / f"flight.{form}"
    path.write_bytes(log.data)
    whole = open_log(path)
    count = sum(len(track) for track in whole.tracks())
    at = next(number for number, part in enumerate(log.parts[700:], 700) if len(part) > 30)
    offset = 3 if form == "bin" else 5
    log.parts[at] = log.parts[at][:offset] + struct.pack("<Q", 1 << 60) + log.parts[at][offset + 8 :]
    path.write_bytes(log.data)
    found = open_log(path)
    assert found.summary.end_s == pytest.approx(whole.summary.end_s)
    assert sum(len(track) for track in found.tracks()) >= count - 2
    assert any(
        "1 message ignored: the time is far from the neighbours'" in doubt for doubt in found.summary.time_base.doubts
    )
