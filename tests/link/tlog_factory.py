"""Makes tlogs of any kind, and counts them as pymavlink does."""

from __future__ import annotations

import contextlib
import io
import os
import struct
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

START_US = 1_700_000_000_000_000


class Recorder:
    """Packs messages as several vehicles would, one stamp before each."""

    def __init__(self) -> None:
        from pymavlink.dialects.v20 import all as dialect

        self.dialect = dialect
        self.out = io.BytesIO()
        self._links: dict[tuple[int, bool, bool], object] = {}

    def link(self, system: int, *, first_version: bool, signed: bool):
        key = (system, first_version, signed)
        if key not in self._links:
            link = self.dialect.MAVLink(io.BytesIO(), srcSystem=system, srcComponent=1)
            if signed:
                link.signing.secret_key = b"k" * 32
                link.signing.sign_outgoing = True
                link.signing.link_id = 1
            self._links[key] = link
        return self._links[key]

    def frame(self, message, system: int = 1, *, first_version: bool = False, signed: bool = False) -> bytes:
        link = self.link(system, first_version=first_version, signed=signed)
        frame = bytes(message.pack(link, force_mavlink1=first_version))
        link.seq = (link.seq + 1) % 256
        return frame

    def add(
        self, time_s: float, message, system: int = 1, *, first_version: bool = False, signed: bool = False
    ) -> None:
        self.out.write(struct.pack(">Q", START_US + round(time_s * 1e6)))
        self.out.write(self.frame(message, system, first_version=first_version, signed=signed))

    def garbage(self, data: bytes) -> None:
        self.out.write(data)

    @property
    def data(self) -> bytes:
        return self.out.getvalue()


def mixed_log(seed: int, count: int, *, garbage: float = 0.0, signed: bool = True) -> bytes:
    """A log with both versions, signatures, three systems, and garbage between some of the packets."""
    generator = np.random.default_rng(seed)
    log = Recorder()
    kinds = log.dialect
    for number in range(count):
        time_s = 0.02 * number
        message = [
            lambda t: kinds.MAVLink_attitude_message(int(t * 1000), 0.1, -0.05, 1.0, 0.0, 0.0, 0.0),
            lambda t: kinds.MAVLink_global_position_int_message(
                int(t * 1000), 470000000, 80000000, 500000, 60000, 1000, -500, 0, 9000
            ),
            lambda _: kinds.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3),
            lambda _: kinds.MAVLink_mission_current_message(3),
            lambda _: kinds.MAVLink_statustext_message(6, b"all is well"),
            lambda _: kinds.MAVLink_sys_status_message(0, 0, 0, 500, 22000, 1500, 70, 0, 0, 0, 0, 0, 0),
        ][int(generator.integers(6))](time_s)
        first = bool(generator.random() < 0.4)
        log.add(
            time_s,
            message,
            int(generator.choice([1, 2, 255])),
            first_version=first,
            signed=bool(signed and not first and generator.random() < 0.5),
        )
        if generator.random() < garbage:
            log.garbage(generator.integers(0, 256, int(generator.integers(1, 60)), dtype=np.uint8).tobytes())
    return log.data


def counted_by_pymavlink(path: Path) -> tuple[dict[str, int], int]:
    """Messages by type, and bad records, as pymavlink counts them.

    It opens a log by ``mavlink_connection``, which first looks through the whole of it for an index; where it cannot, by its
    plain reader.
    """
    from pymavlink import mavutil

    before = os.environ.get("MAVLINK20")
    os.environ["MAVLINK20"] = "1"  # else a log that begins with version 1 is read without the types of version 2
    mavutil.set_dialect("all")
    try:
        log = mavutil.mavlink_connection(str(path), dialect="all")
    except AttributeError:  # its index found a header, and no message behind it
        log = mavutil.mavlogfile(str(path))
    counts: Counter[str] = Counter()
    with contextlib.redirect_stdout(io.StringIO()):
        while (message := log.recv_msg()) is not None:
            counts[message.get_type()] += 1
    log.close()
    if before is None:
        os.environ.pop("MAVLINK20", None)
    return {name: number for name, number in counts.items() if name != "BAD_DATA"}, counts["BAD_DATA"]
