"""Every byte of a connection is kept, and found again by others."""

import os
import subprocess
import sys

import pytest
from pymavlink import mavutil
from wires import Scene, a_mission

from link.connection import Connection
from link.recorder import Recorder
from link.verified import upload_verified
from models.errors import InputError


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


def test_a_killed_process_loses_less_than_a_second(tmp_path):
    code = (
        "import os, sys, time\n"
        "from pathlib import Path\n"
        "from link.recorder import Recorder\n"
        "from models.clock import WallClock\n"
        "recorder = Recorder(Path(sys.argv[1]), WallClock())\n"
        "begun = time.monotonic()\n"
        "while time.monotonic() < begun + 1.2:\n"
        "    recorder.frame(b'x' * 20)\n"
        "    time.sleep(0.005)\n"
        "print(time.time(), flush=True)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, check=False)
    data = next(tmp_path.glob("*.tlog")).read_bytes()
    last = len(data) // 28 * 28 - 28
    assert float(done.stdout) - int.from_bytes(data[last : last + 8], "big") * 1e-6 < 1.0


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is forbidden to root")
def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="recording cannot be written"):
        recorded(tmp_path / "more")


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "rec").write_text("")
    with pytest.raises(InputError, match="recording cannot be written"):
        recorded(tmp_path / "rec")
