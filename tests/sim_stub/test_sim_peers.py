"""Real clients decide what is right: pymavlink's mavutil and mavwp, MAVSDK, MAVProxy, at wall time."""

import math
import os
import shutil
import socket
import subprocess
import sys
import threading
import time

import pytest
from sim_serving import free_port, served
from sim_station import LAT, LON, item, leg

from skyway.models.queues.pad_service import PadRequest, decode_answer, encode
from skyway.sim_stub.plant.physics import offset_m

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


def wait(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never happened"
        time.sleep(0.02)


def landed_north_m(running):
    body = running.world.vehicles[1].body
    return offset_m(LAT, LON, body.lat, body.lon)[0]


@pytest.mark.parametrize("autopilot", ["ardupilot", pytest.param("px4", marks=pytest.mark.slow)])
def test_mavsdk_arms_flies_a_mission_and_moves_fence_rally_parameters_and_telemetry(autopilot):
    mavsdk = pytest.importorskip("mavsdk")
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.mission_raw import MissionItem, MissionRaw
    from mavsdk.plugins.param import Param
    from mavsdk.plugins.telemetry import Telemetry

    def converted(items, kind=0):
        return [
            MissionItem(n, f, c, int(n == 0), 1, *map(float, p), x, y, float(z), kind)
            for n, (f, c, *p, x, y, z) in enumerate(items)
        ]

    port = free_port()
    with served(connect=[f"udpout:127.0.0.1:{port}"], autopilot=autopilot, speedup=20) as running:
        sdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
        sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        system = sdk.first_autopilot(5.0)
        telemetry, action, missions, parameters = Telemetry(system), Action(system), MissionRaw(system), Param(system)
        real, whole = {"px4": ("MPC_XY_CRUISE", "COM_DL_LOSS_T"), "ardupilot": ("WPNAV_SPEED", "FS_OPTIONS")}[autopilot]
        fast = 10.0 if autopilot == "px4" else 1000.0
        parameters.set_param_float(real, fast)
        parameters.set_param_int(whole, 40)
        assert parameters.get_param_float(real) == fast
        assert parameters.get_param_int(whole) == 40
        everything = parameters.get_all_params()
        store = running.world.vehicles[1].autopilot.parameters
        assert len(everything.int_params) + len(everything.float_params) == len(store)
        home = [item(16, z=0, frame=0)] if autopilot == "ardupilot" else []
        missions.upload_mission(converted([*home, *leg(distance=150)]))
        assert len(missions.download_mission()) == 3 + len(home)
        box = [item(5001, n, e, p=(4, 0, 0, 0)) for n, e in ((-500, -500), (-500, 500), (500, 500), (500, -500))]
        missions.upload_geofence(converted(box, 1))
        assert len(missions.download_geofence()) == 4
        missions.upload_rally_points(converted([item(5100, 50, p=(0, 0, 0, 0))], 2))
        assert len(missions.download_rallypoints()) == 1
        action.set_takeoff_altitude(10.0)
        action.arm()
        action.takeoff()
        wait(telemetry.in_air)
        wait(lambda: telemetry.position().relative_altitude_m > 8.0 or autopilot == "ardupilot", 10.0)
        missions.start_mission()
        wait(lambda: not running.world.vehicles[1].autopilot.armed)
        wait(lambda: not telemetry.armed())
        assert landed_north_m(running) == pytest.approx(150.0, abs=3.0)
        sdk.destroy()


@pytest.mark.parametrize("autopilot", ["px4", pytest.param("ardupilot", marks=pytest.mark.slow)])
def test_mavutil_and_mavwp_over_tcp_upload_read_back_and_fly(autopilot):
    from pymavlink import mavutil, mavwp

    with served(tcp_port=0, autopilot=autopilot, speedup=20) as running:
        host, port = running.where()
        link = mavutil.mavlink_connection(f"tcp:{host}:{port}", autoreconnect=False)
        link.wait_heartbeat(timeout=5)
        link.param_fetch_all()
        seen = set()
        count = len(running.world.vehicles[1].autopilot.parameters)
        while len(seen) < count:
            seen.add(link.recv_match(type="PARAM_VALUE", blocking=True, timeout=5).param_id)
        loader = mavwp.MAVWPLoader(1, 1)
        home = [item(16, z=0, frame=0)] if autopilot == "ardupilot" else []
        for seq, (frame, command, *p, x, y, z) in enumerate([*home, *leg(distance=100)]):
            p[3] = 0.0 if math.isnan(p[3]) else p[3]
            loader.add(
                mavutil.mavlink.MAVLink_mission_item_message(1, 1, seq, frame, command, 0, 1, *p, x * 1e-7, y * 1e-7, z)
            )
        link.waypoint_clear_all_send()
        link.recv_match(type="MISSION_ACK", blocking=True, timeout=3)
        link.waypoint_count_send(loader.count())
        for _ in range(loader.count()):
            asked = link.recv_match(type=["MISSION_REQUEST", "MISSION_REQUEST_INT"], blocking=True, timeout=3)
            link.mav.send(loader.wp(asked.seq))
        assert link.recv_match(type="MISSION_ACK", blocking=True, timeout=3).type == 0
        link.waypoint_request_list_send()
        assert link.recv_match(type="MISSION_COUNT", blocking=True, timeout=3).count == loader.count()
        for seq in range(loader.count()):
            link.waypoint_request_send(seq)
            assert link.recv_match(type="MISSION_ITEM", blocking=True, timeout=3).seq == seq
        link.mav.mission_ack_send(1, 1, 0)
        if autopilot == "ardupilot":
            link.set_mode("GUIDED")
        link.arducopter_arm()
        link.motors_armed_wait()
        link.mav.command_long_send(1, 1, 300, 0, 0, 0, 0, 0, 0, 0, 0)
        wait(lambda: not running.world.vehicles[1].autopilot.armed)
        link.motors_disarmed_wait()
        assert landed_north_m(running) == pytest.approx(100.0, abs=3.0)
        link.close()


def test_two_ground_stations_at_once_over_udp_each_get_their_answers():
    from pymavlink import mavutil

    with served(connect=["udpin:127.0.0.1:0"], autopilot="ardupilot") as running:
        host, port = running.where()
        links = [mavutil.mavlink_connection(f"udpout:{host}:{port}", source_system=number) for number in (255, 254)]
        for link in links:
            link.mav.heartbeat_send(6, 8, 0, 0, 4)
        for link in links:
            link.wait_heartbeat(timeout=5)
        links[0].mav.param_request_read_send(1, 1, b"WPNAV_SPEED", -1)
        assert links[0].recv_match(type="PARAM_VALUE", blocking=True, timeout=3).param_id == "WPNAV_SPEED"
        assert links[1].recv_match(type="PARAM_VALUE", blocking=True, timeout=0.3) is None
        links[1].mav.param_set_send(1, 1, b"WPNAV_SPEED", 700.0, 9)
        for link in links:
            assert link.recv_match(type="PARAM_VALUE", blocking=True, timeout=3).param_value == 700.0
        assert set(running.world.vehicles[1].ground_heard) == {255, 254}
        for link in links:
            link.close()


def test_five_vehicles_on_one_port_each_have_their_own_system_id():
    from pymavlink import mavutil

    port = free_port()
    link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}")
    with served(connect=[f"udpout:127.0.0.1:{port}"], vehicles=5, first_system=11):
        seen = set()
        end = time.monotonic() + 5.0
        while len(seen) < 5 and time.monotonic() < end:
            message = link.recv_match(type="HEARTBEAT", blocking=True, timeout=1)
            seen.add(message.get_srcSystem() if message else None)
        assert seen == {11, 12, 13, 14, 15}
    link.close()


def test_pads_over_tcp():
    with served(tcp_port=0, pads="tcp:127.0.0.1:0", soc=0.5) as running:
        with socket.create_connection(running.where(1), timeout=5.0) as client:
            lines = client.makefile("rb")
            client.sendall(encode(PadRequest(op="charge", station="here", drone="1", to_soc=0.9)))
            answer = decode_answer(lines.readline())
            assert (answer.ok, answer.drone.state, answer.station.busy) == (True, "charging", 1)
            client.sendall(b"what?\n" + encode(PadRequest(op="status", station="nowhere")))
            assert [decode_answer(lines.readline()).ok for _ in range(2)] == [False, False]
            client.sendall(encode(PadRequest(op="release", station="here", drone="1")))
            assert decode_answer(lines.readline()).station.busy == 0
        with socket.create_connection(running.where(1), timeout=5.0) as client:
            client.sendall(b"x" * 100_000)
            answer = decode_answer(client.makefile("rb").readline())
            assert answer.error == "the line is too long"


def test_the_command_runs_prints_events_and_stops_cleanly_on_ctrl_c():
    script = (
        "import typer, sys; from skyway.cli.command_groups import add_command; app = typer.Typer();"
        "add_command(app, 'sim'); app.callback()(lambda: None); app(sys.argv[1:])"
    )
    arguments = ["sim", "--at", "bellevue", "--tcp", "0", "--speedup", "20", "--fault", "gps@1s+1s"]
    process = subprocess.Popen(
        [sys.executable, "-u", "-c", script, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    lines = [process.stdout.readline() for _ in range(4)]
    process.send_signal(2)
    rest, errors = process.communicate(timeout=10)
    assert lines[0].startswith("vehicle 1: tcp:127.0.0.1:")
    assert any("autopilot is up" in line for line in lines)
    assert rest.splitlines()[-1].endswith("ended")
    assert process.returncode == 0, errors


@pytest.mark.slow
@BOTH
def test_mavproxy_scripted(autopilot, tmp_path):
    program = os.environ.get("MAVPROXY") or shutil.which("mavproxy.py")
    if program is None:
        pytest.skip("MAVProxy is not installed here (pip install MAVProxy, or set MAVPROXY to its path)")
    lines = ["QGC WPL 110"]
    home = [item(16, z=0, frame=0)] if autopilot == "ardupilot" else []
    for seq, (frame, command, *p, x, y, z) in enumerate([*home, *leg(distance=100)]):
        plain = [0.0 if math.isnan(v) else v for v in p]
        fields = [seq, int(seq == 0), frame, command, *plain, x * 1e-7, y * 1e-7, z, 1]
        lines.append("\t".join(str(v) for v in fields))
    path = tmp_path / "mission.txt"
    path.write_text("\n".join(lines) + "\n")
    with served(tcp_port=0, autopilot=autopilot, speedup=10) as running:
        host, port = running.where()
        process = subprocess.Popen(
            [program, f"--master=tcp:{host}:{port}", f"--state-basedir={tmp_path}"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=tmp_path,
        )
        shown = bytearray()
        reader = threading.Thread(target=lambda: [shown.extend(line) for line in process.stdout])
        reader.start()

        def type_in(command):
            process.stdin.write(command.encode() + b"\n")
            process.stdin.flush()

        try:
            vehicle = running.world.vehicles[1]
            wait(lambda: b"online system 1" in shown, 30.0)
            type_in(f"wp load {path}")
            wait(lambda: len(vehicle.autopilot.run.items) == 3 + len(home), 30.0)
            if autopilot == "ardupilot":
                type_in("mode GUIDED")
                wait(lambda: vehicle.autopilot.mode.value == "guided")
            type_in("arm throttle")
            wait(lambda: vehicle.autopilot.armed, 30.0)
            type_in("long MISSION_START 0 0 0 0 0 0 0")
            wait(lambda: not vehicle.autopilot.landed, 30.0)
            wait(lambda: not vehicle.autopilot.armed, 60.0)
            assert landed_north_m(running) == pytest.approx(100.0, abs=3.0)
        finally:
            process.kill()
            process.wait()
            reader.join()
            process.stdin.close()
            process.stdout.close()
