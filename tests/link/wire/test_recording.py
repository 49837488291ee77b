"""Every byte of a connection is kept, and found again by others."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time

import pytest
from pymavlink import mavutil
from sim_serving import free_port
from wires import Scene, a_mission

from skyway.link.protocol.connection import Connection
from skyway.link.protocol.verified import upload_verified
from skyway.link.wire.frames import FrameWriter
from skyway.link.wire.recorder import Recorder
from skyway.models.base.errors import InputError


def recorded(tmp_path, **how):
    scene = Scene("px4")
    recorder = Recorder(tmp_path, scene.lockstep.clock, name="udpin-14540", **how)
    scene.connection = Connection(scene.link, scene.lockstep.clock, recorder=recorder)
    return scene, recorder


def test_received_and_sent_are_recorded_from_the_first_byte_and_pymavlink_reads_them(tmp_path):
    scene, recorder = recorded(tmp_path)
    assert scene.connection.perform(upload_verified(scene.job(a_mission(20)))).verified
    scene.connection.close()
    log = mavutil.mavlink_connection(str(recorder.paths[0]))
    found = []
    while (message := log.recv_msg()) is not None:
        found.append((message.get_type(), message.get_srcSystem(), message._timestamp))
    log.close()
    assert found[0][:2] == ("HEARTBEAT", 255)
    assert sum(kind == "MISSION_ITEM_INT" for kind, system, _ in found if system == 255) == 20
    assert sum(kind == "MISSION_ITEM_INT" for kind, system, _ in found if system == 1) == 20
    times = [at for _, _, at in found]
    assert times == sorted(times)
    assert times[0] == pytest.approx(scene.world.epoch_s, abs=1.0)


def test_a_big_recording_goes_on_in_the_next_file_and_nothing_is_overwritten(tmp_path):
    scene, recorder = recorded(tmp_path, max_bytes=20_000)
    scene.connection.run_for(60.0)
    scene.connection.close()
    assert len(recorder.paths) > 2
    assert len(set(recorder.paths)) == len(recorder.paths)
    assert all(path.stat().st_size < 20_500 for path in recorder.paths)


LISTEN = """
import sys
from pathlib import Path
from skyway.link.protocol.opening import open_connection
connection = open_connection(f"udpin:127.0.0.1:{sys.argv[1]}", record=Path(sys.argv[2]))
while True:
    connection.pump(0.1)
"""


def test_a_process_that_is_killed_loses_less_than_a_second_of_its_connection(tmp_path):
    """A vehicle speaks to a program of ours at 100 messages a second; it is killed with signal 9 after a second."""
    port = free_port()
    process = subprocess.Popen([sys.executable, "-c", LISTEN, str(port), str(tmp_path)])
    writer, sent = FrameWriter(1, 1), {}
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as vehicle:
        heard, number, end = None, 0, time.monotonic() + 30.0
        while time.monotonic() < end and (heard is None or time.monotonic() < heard + 1.3):
            number += 1
            sent[number] = time.time()
            vehicle.sendto(writer.frame("ATTITUDE", {"time_boot_ms": number}), ("127.0.0.1", port))
            if heard is None and list(tmp_path.glob("*.tlog")) and next(tmp_path.glob("*.tlog")).stat().st_size:
                heard = time.monotonic()
            time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    killed = time.time()
    process.wait(10.0)
    assert heard is not None, "it never recorded anything"
    log = mavutil.mavlink_connection(str(next(tmp_path.glob("*.tlog"))))
    recorded, ours = [], 0
    while (message := log.recv_msg()) is not None:
        if message.get_type() == "ATTITUDE":
            recorded.append(message.time_boot_ms)
        ours += message.get_srcSystem() == 255
    log.close()
    assert ours >= 1
    assert recorded == list(range(recorded[0], recorded[-1] + 1))
    assert killed - sent[recorded[-1]] < 1.0


def test_a_disk_that_fails_ends_the_recording_and_not_the_link(tmp_path):
    scene, recorder = recorded(tmp_path)
    scene.connection.run_for(2.0)

    class Full:
        def write(self, _data):
            raise OSError(28, "No space left on device")

        def close(self):
            raise OSError(5, "Input/output error")

    recorder._file.close()
    recorder._file = Full()
    assert scene.connection.perform(upload_verified(scene.job(a_mission(8)))).verified
    assert recorder.problem == "the recording ends: No space left on device"
    scene.connection.close()


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is forbidden to root")
def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="recording cannot be written"):
        recorded(tmp_path / "more")


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "rec").write_text("")
    with pytest.raises(InputError, match="recording cannot be written"):
        recorded(tmp_path / "rec")
