"""The clients of others fetch logs from the simulator: what skyway is tested with is not only skyway's idea of it."""

import contextlib
import threading

import pytest
from sim_serving import free_port, served

from skyway.sim_stub.transports.channel import Impairment

DEADLINE_S = 240.0
"""Far more than it takes, since the machine may be busy."""
SIZES = (4_000, 100_000)


def content(there, number=-1):
    return bytes(list(next(iter(there.world.vehicles.values())).card.files.values())[number].content)


@contextlib.contextmanager
def pymavlinks_client(there):
    from pymavlink import mavftp, mavutil

    host, port = there.where()
    link = mavutil.mavlink_connection(f"tcp:{host}:{port}", source_system=255, source_component=190)
    try:
        assert link.wait_heartbeat(timeout=10.0) is not None
        yield mavftp.MAVFTP(link, target_system=1, target_component=1)
    finally:
        link.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("autopilot", "folder", "firmware"),
    [("px4", "/fs/microsd/log", ""), ("ardupilot", "/APM/LOGS", "4.7"), ("ardupilot", "/APM/LOGS", "4.6")],
)
@pytest.mark.parametrize("loss", [0.0, 0.03])
def test_pymavlinks_client_lists_fetches_and_checks_a_log(autopilot, folder, firmware, loss, tmp_path):
    bad = Impairment(loss=loss, delay_s=0.005)
    with (
        served(tcp_port=0, autopilot=autopilot, firmware=firmware, logs=SIZES, impairment=bad) as there,
        pymavlinks_client(there) as client,
    ):
        listed = client.cmd_list([folder])
        assert listed.error_code == 0
        names = {entry.name: entry.size_b for entry in listed.directory_listing}
        if autopilot == "px4":
            (day,) = names
            path = f"{folder}/{day}/13_00_00.ulg"
        else:
            assert names == {"00000001.BIN": SIZES[0], "00000002.BIN": SIZES[1]}
            path = f"{folder}/00000002.BIN"
        here = tmp_path / "log"
        client.cmd_get([path, str(here)])
        ended = client.process_ftp_reply("OpenFileRO", timeout=DEADLINE_S)
        assert ended.error_code == 0, ended.error_code
        assert here.read_bytes() == content(there)


@pytest.fixture
def sdk():
    mavsdk = pytest.importorskip("mavsdk")
    made = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    yield made
    made.destroy()


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_mavsdks_clients_fetch_a_log_either_way(autopilot, sdk, tmp_path):
    from mavsdk.plugins.ftp import Ftp
    from mavsdk.plugins.log_files import LogFiles

    port = free_port()
    with served(connect=(f"udpout:127.0.0.1:{port}",), autopilot=autopilot, logs=SIZES) as there:
        sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        found = threading.Event()
        sdk.subscribe_on_new_system(lambda *_: found.set())
        assert sdk.get_systems() or found.wait(20.0)
        (system,) = sdk.get_systems()
        logs = LogFiles(system)
        entries = logs.get_entries()
        assert [entry.size_bytes for entry in entries] == list(SIZES)
        ended = threading.Event()
        results = []

        def progress(result, *_):
            results.append(result.name)
            if result.name != "NEXT":
                ended.set()

        logs.download_log_file_async(entries[-1], str(tmp_path / "by-requests"), progress)
        assert ended.wait(DEADLINE_S), results[-1:]
        assert (tmp_path / "by-requests").read_bytes() == content(there)
        path = list(next(iter(there.world.vehicles.values())).card.files)[-1]
        ended.clear()
        Ftp(system).download_async(path, str(tmp_path), True, progress)
        assert ended.wait(DEADLINE_S), results[-1:]
        assert (tmp_path / path.rpartition("/")[2]).read_bytes() == content(there)
