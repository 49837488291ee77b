"""The demonstration of a fleet: what is drawn can be flown, is the same each time, and is flown and shown to its end."""

import contextlib
import math
import os
import re
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request

import pytest
from fleet_runs import ROOT, START
from simulated import world_of

from benchmarks.fleet.invariants import judge
from skyway.cli.main import main
from skyway.dispatch.demonstration import FLEET, JOURNALS, LEDGER, ORDERS, FleetDemo, draw, run_demo
from skyway.dispatch.status import outcome
from skyway.link.wire.frames import FrameWriter
from skyway.models.base.errors import InputError
from skyway.models.base.geodesy import distance_m
from skyway.models.orders.files import read_orders, read_vehicles
from skyway.models.orders.fitting import fit
from skyway.planner.capacity.demand import Demand
from skyway.scenarios import load_scenario
from skyway.sim_stub.transports.lockstep_client import LockstepClient


def test_what_is_drawn_fits_the_city_and_is_the_same_each_time(tmp_path):
    demo = FleetDemo(folder=tmp_path, drones=20, rate_per_h=40.0, seed=3)
    drones, orders = draw(demo)
    assert draw(demo) == (drones, orders)
    assert draw(FleetDemo(folder=tmp_path, drones=20, rate_per_h=40.0, seed=4)) != (drones, orders)
    (tmp_path / "fleet.csv").write_text(drones)
    (tmp_path / ORDERS).write_text(orders)
    scenario = load_scenario(None)
    work = fit(scenario, read_orders(tmp_path / ORDERS), read_vehicles(tmp_path / "fleet.csv"))
    assert len(work.vehicles) == 20
    assert 20 <= len(work.orders) <= 60
    place = {one.id: (one.lat, one.lon) for one in scenario.network.stations}
    for order in work.orders:
        assert START <= order.ready < order.due
        assert (
            0.0 < distance_m(*place[order.origin], *place[order.destination]) <= 1.01 * Demand(most_per_h=1.0).within_m
        )


def test_a_time_without_orders_is_told(tmp_path):
    with pytest.raises(InputError, match="greater --rate or --hours"):
        draw(FleetDemo(folder=tmp_path, rate_per_h=0.1, hours=0.01))


def contents(folder):
    return {str(one.relative_to(folder)): one.read_bytes() for one in folder.rglob("*") if one.is_file()}


def test_the_files_of_a_real_fleet_are_not_touched(tmp_path, capsys):
    (tmp_path / JOURNALS).mkdir()
    for name in (LEDGER, ORDERS, FLEET, f"{JOURNALS}/1.jsonl"):
        (tmp_path / name).write_text("of a real fleet")
    before = contents(tmp_path)
    assert main(["dispatch", "demo", "--no-page", "-o", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "--output: has files that no demonstration has written (fleet.db, orders.csv, fleet.csv, flights)" in said
    assert f"{tmp_path}: --output" in said
    assert "name a new folder" in said
    assert contents(tmp_path) == before


def test_a_running_demonstration_keeps_its_folder_and_the_next_one_takes_it(tmp_path):
    demo = FleetDemo(folder=tmp_path, drones=1, rate_per_h=30.0, hours=0.1, seed=5, workers=1)
    seen = []

    def show(_):
        (tmp_path / JOURNALS / "mine.jsonl").write_text("a journal")
        with pytest.raises(InputError, match="--output: is in use: another demonstration runs there"):
            run_demo(demo, seen.append, show=seen.append)
        assert (tmp_path / JOURNALS / "mine.jsonl").exists()
        seen.append("refused")

    run_demo(demo, lambda _: None, show=show)
    assert seen == ["refused"]
    with pytest.raises(InputError, match="no order is drawn"):
        run_demo(FleetDemo(folder=tmp_path, rate_per_h=0.1, hours=0.01), seen.append)
    assert (tmp_path / JOURNALS / "mine.jsonl").exists()
    run_demo(demo, lambda _: None, show=lambda _: seen.append((tmp_path / JOURNALS / "mine.jsonl").exists()))
    assert seen == ["refused", False]


@pytest.mark.parametrize("command", [["dispatch", "demo", "--no-page"], ["demo"]])
def test_a_folder_that_cannot_be_made_is_told_with_its_option(tmp_path, capsys, command):
    (tmp_path / "file").touch()
    assert main([*command, "-o", str(tmp_path / "file" / "x")]) == 2
    said = capsys.readouterr().err
    assert f"{tmp_path / 'file' / 'x'}: --output: the folder cannot be made: Not a directory;" in said
    assert "name a folder" in said


def test_bytes_come_at_whole_seconds_and_at_once_where_some_were_sent():
    with world_of(vehicles=1) as address:
        client = LockstepClient(address, "test", system=1)
        instants = []
        for _ in range(4):
            assert client.read(30.0)
            instants.append(client.now_s())
        assert all(abs(one - round(one)) < 1e-6 for one in instants)
        assert len(set(instants)) == 4
        client.sleep_until(instants[-1] + 0.2)
        client.write(b"\0")  # no frame, but somebody speaks
        client.read(30.0)
        assert client.now_s() - instants[-1] < 0.5
        client.sleep_until(math.ceil(client.now_s()) + 0.4)
        began_s = client.now_s()
        client.write(FrameWriter(255, 190).frame("HEARTBEAT", {"type": 6, "autopilot": 8}))  # which nobody answers
        while client.read(30.0) and client.now_s() == began_s:  # what was there already
            pass
        assert client.now_s() == pytest.approx(math.ceil(began_s))
        client.close()


@pytest.mark.slow
def test_a_small_fleet_is_flown_to_its_end_and_audited(tmp_path):
    words = ["--drones", "2", "--rate", "30", "--hours", "0.07", "--seed", "5", "--no-page", "--workers", "1"]
    done = subprocess.run(
        [sys.executable, "-m", "skyway", "dispatch", "demo", *words, "-o", str(tmp_path / "out")],
        env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=1800, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-2:] == outcome(str(tmp_path / "out" / "fleet.db"), "dispatch")
    assert "no pad was held twice" in done.stdout
    assert judge(str(tmp_path / "out" / "fleet.db")).wrong == []
    found = re.search(r"(\d+) orders?: (.*);", done.stdout)
    counts = [int(one) for one in re.findall(r"(\d+) (?:delivered|refused|handed)", found[2])]
    assert sum(counts) == int(found[1])


@pytest.mark.slow
def test_the_page_shows_it_and_ctrl_c_ends_everything(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-m", "skyway", "dispatch", "demo", "--drones", "4", "--rate", "30", "--port", "0", "-o", str(tmp_path / "out")],
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        address = re.search(r"http://\S+/fleet\?ledger=fleet\.db", next(iter(process.stderr)))[0]
        asked = address.split("/fleet")[0] + "/api/dispatch?ledger=fleet.db&holder=dispatch"
        told, end = "", time.monotonic() + 600.0
        written = tmp_path / "out" / "flights" / "world.address"
        while not ('"vehicles":[{' in told and written.exists()) and time.monotonic() < end:
            with contextlib.suppress(urllib.error.HTTPError), urllib.request.urlopen(asked, timeout=120) as answer:
                told = answer.read().decode()  # refused until the service has begun
            time.sleep(0.5)
        assert told.count('"stale":') == 4
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(120) == 0
        process.stderr.close()
    world = written.read_text().strip()
    from skyway.models.base.errors import LinkLostError

    with pytest.raises(LinkLostError):
        LockstepClient(world, "test")
