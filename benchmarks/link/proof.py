"""Proof of delivery, judged by the simulator's own physics: good releases and injected failures, on both autopilots.

Each delivery: take-off under the package, a leg, landing, release, take-off again. The simulator's power and drag are not those by which the
package is weighed; each vehicle draws up to 5 % more or less than thought, wind and gusts blow, the wind shifts on the ground, and the wind that the scale is
told is off. `python -m benchmarks.link.proof --good 1000 --bad 200`.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import random
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from skyway.link.protocol.connection import Connection
from skyway.link.supervisor.flight.release import HANGS_S, LINE_M
from skyway.link.supervisor.proof.evidence import Evidence, Verdict, judge
from skyway.link.supervisor.proof.scale_of import scale_of
from skyway.link.supervisor.proof.weighing import END_S, Weight
from skyway.link.vehicle.vehicle import Vehicle
from skyway.missions.builder.release_items import release_range
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.mission import Mission, MissionItem
from skyway.models.base.errors import LinkError
from skyway.models.composition.release import WINCH_HEIGHT_M, WINCH_SLACK_M, winch_s
from skyway.models.drones.drone import M200_V2
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.faults import Fault
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.lockstep import Lockstep
from skyway.sim_stub.world import World

LAT, LON, GROUND_M = 40.7392, -73.9756, 5.0
FAILURES = ("stuck", "early", "half", "silent", "jammed")
"""Acknowledged and not released; lost on the way; half of it released; the gripper does not move and says so; a winch that jams."""
HEIGHT_M, LEG_M = 45.0, 300.0


@dataclass(frozen=True)
class Run:
    """One delivery that was judged."""

    seed: int
    autopilot: str
    failure: str
    verdict: str
    reason: str
    after_s: float
    """After the second take-off; 0 where it was known before."""


def _mission(north_m: float, *, back: bool) -> Mission:
    ends = [LAT, LAT + north_m / 111_000.0]
    begin, end = (round(one * 1e7) for one in (reversed(ends) if back else ends))
    y = round(LON * 1e7)

    def item(command: Command, x: int, z: float) -> MissionItem:
        return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, x=x, y=y, z=z, param4=math.nan)

    up, over = item(Command.NAV_TAKEOFF, begin, HEIGHT_M), item(Command.NAV_WAYPOINT, end, HEIGHT_M)
    return Mission((up, over, item(Command.NAV_LAND, end, 0.0)))


def _lowering() -> Mission:
    """Out, hover, line out and in, and on the way back."""
    out = _mission(LEG_M, back=False).items
    over = out[1]
    hover = dataclasses.replace(over, z=WINCH_HEIGHT_M)
    wait = dataclasses.replace(hover, command=Command.NAV_LOITER_TIME, param1=winch_s(), param4=0.0)
    length_m = WINCH_HEIGHT_M + WINCH_SLACK_M
    down, up = (MissionItem(Command.DO_WINCH, Frame.MISSION, 1.0, 1.0, metres, 1.0) for metres in (length_m, -length_m))
    return Mission((*out[:2], hover, down, wait, up, wait, over, *_mission(LEG_M, back=True).items[1:]))


class Stage:
    """One vehicle with its package, and the scale that it is."""

    def __init__(self, rng: random.Random, seed: int, autopilot: str, failure: str, package_kg: float) -> None:
        wind_mps, towards = rng.uniform(0.0, 9.0), rng.uniform(0.0, 360.0)
        self.world = World(wind=ConstantWind.of(wind_mps, towards), faults=_faults(failure, rng))
        ardupilot = (("GRIP_ENABLE", 1.0), ("WINCH_TYPE", float(rng.choice((1, 2)))))
        gripper = ardupilot if autopilot == "ardupilot" else (("PD_GRIPPER_EN", 1.0),)
        self.craft = self.world.add(
            VehicleConfig(
                lat=LAT, lon=LON, ground_m=GROUND_M, autopilot=autopilot, seed=seed, warm=True,
                payload_kg=package_kg, parameters=gripper,
            )
        )  # fmt: skip
        lockstep = Lockstep(self.world)
        self.connection = Connection(lockstep.connect(self.craft, seed=seed), lockstep.clock)
        self.vehicle = Vehicle(self.connection)
        self.vehicle.request_telemetry()
        self.scale = scale_of(M200_V2, package_kg, None)
        self.off = rng.gauss(0.0, 0.8), rng.gauss(0.0, 0.8)
        """Error of the wind that the scale is told, (north, east), m/s."""
        self.lost_s: float | None = None
        self.before: Weight | None = None

    def _keep(self, now_s: float, took_off_s: float) -> None:
        """Keep what the first take-off shows, as the supervisor does."""
        if not self.scale.gains and now_s > took_off_s + END_S:
            self.scale.keep()

    def lower(self) -> tuple[float | None, float]:
        """Fly out, lower the package and leave; returns the line that the winch told, and when it left; 18.5 s later it ends."""
        vehicle, clock, mission = self.vehicle, self.connection.clock, _lowering()
        assert vehicle.upload(mission).verified
        vehicle.start(60.0)
        first, last = release_range(mission.items) or (0, 0)
        begun_s, line_m, asked, took_off_s, left_s = math.nan, None, False, math.nan, math.nan
        end = clock.now_s() + 600.0
        while clock.now_s() < end:
            for s in vehicle.samples(0.5):
                if math.isnan(took_off_s):
                    took_off_s = s.time_s if s.height_m > 0.3 else math.nan
                    if s.height_m > 0.3:
                        self.scale.take_off(s.time_s)
                    continue
                north, east = self.craft.true_wind
                self.scale.hear(s, (north + self.off[0], east + self.off[1]))
                if math.isnan(begun_s):
                    self.lost_s = self.lost_s or self.scale.lost()
                self._keep(s.time_s, took_off_s)
                if s.time_s > left_s + 18.5:
                    return line_m, left_s
            said = vehicle.peer.latest.get("MISSION_CURRENT")
            item = -1 if said is None else said["seq"] - vehicle.family.home_items
            if math.isnan(begun_s) and item >= first:
                begun_s = clock.now_s()
            if self.before is None and clock.now_s() > begun_s + HANGS_S:
                self.before = self.scale.before_release()
            if not asked and clock.now_s() > begun_s + winch_s() - 5.0:
                line_m, asked = vehicle.winch_line_m(), True
            if math.isnan(left_s) and item > last:
                left_s = clock.posix_s()
                self.scale.take_off(left_s)
        raise RuntimeError("it did not leave")

    def fly(self, mission: Mission, until_s: float = math.inf) -> float:
        """Fly until it stands, or so long after its take-off; returns when it took off."""
        vehicle, clock = self.vehicle, self.connection.clock
        assert vehicle.upload(mission).verified
        vehicle.start(60.0)
        took_off_s, end = math.nan, clock.now_s() + 400.0
        while clock.now_s() < end:
            for s in vehicle.samples(0.5):
                if math.isnan(took_off_s):
                    if s.height_m > 0.3:
                        took_off_s = s.time_s
                        self.scale.take_off(s.time_s)
                    continue
                north, east = self.craft.true_wind
                self.scale.hear(s, (north + self.off[0], east + self.off[1]))
                self._keep(s.time_s, took_off_s)
                self.lost_s = self.lost_s or self.scale.lost()
                if s.time_s > took_off_s + until_s:
                    return took_off_s
            if not math.isnan(took_off_s) and not vehicle.armed:
                return took_off_s
        raise RuntimeError("it did not land")


def _faults(failure: str, rng: random.Random) -> tuple[Fault, ...]:
    if failure in ("stuck", "half"):
        return (Fault("gripper-stuck", value=1.0 if failure == "stuck" else 0.5),)
    if failure == "jammed":
        return (Fault("winch-jammed", value=rng.uniform(0.5, 12.0)),)
    if failure == "silent":
        return (Fault("gripper-silent"),)
    if failure == "early":
        return (Fault("package-lost", start_s=rng.uniform(24.0, 64.0), value=1.0, after_take_off=True),)
    return ()


def deliver(seed: int, autopilot: str, failure: str = "", package_kg: float = 0.8) -> Run:
    """Fly one delivery, and judge it."""
    rng = random.Random(f"{seed}/{autopilot}/{failure}")
    stage = Stage(rng, seed, autopilot, failure, package_kg)
    stage.fly(_mission(LEG_M, back=False))
    before = stage.scale.before_release()
    stage.connection.run_for(20.0)
    if rng.random() < 0.5:  # other wind when it leaves
        stage.craft.faults.add(Fault("wind-shift", value=rng.uniform(0.0, 4.0)), stage.world.sim_s)
    acknowledged = True
    try:
        stage.vehicle.release()
    except LinkError:
        acknowledged = False
    evidence = Evidence(acknowledged=acknowledged, lost_s=stage.lost_s, before=before, package_kg=package_kg)
    after_s = 0.0
    if acknowledged and not evidence.lost:
        took_off_s = stage.fly(_mission(LEG_M, back=True), until_s=18.5)
        evidence = dataclasses.replace(evidence, weight=stage.scale.weigh())
        after_s = stage.connection.clock.posix_s() - took_off_s
    verdict, reason = judge(evidence)
    return Run(seed, autopilot, failure, str(verdict), reason, after_s)


def lower(seed: int, autopilot: str, failure: str = "", package_kg: float = 0.8) -> Run:
    """Fly one delivery by winch, and judge it."""
    rng = random.Random(f"winch/{seed}/{autopilot}/{failure}")
    stage = Stage(rng, seed, autopilot, failure, package_kg)
    line_m, left_s = stage.lower()
    told = None if line_m is None else line_m >= WINCH_HEIGHT_M - LINE_M
    evidence = Evidence(told, how="the winch", lost_s=stage.lost_s, before=stage.before, package_kg=package_kg)
    evidence = dataclasses.replace(evidence, weight=stage.scale.weigh())
    verdict, reason = judge(evidence)
    after_s = 0.0 if told is False or evidence.lost else stage.connection.clock.posix_s() - left_s
    return Run(seed, autopilot, failure, str(verdict), reason, after_s)


def _by_winch(case: tuple[int, str, str]) -> Run:
    return lower(*case)


def _one(case: tuple[int, str, str]) -> Run:
    return deliver(*case)


def main() -> None:
    """Fly them all, and count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--good", type=int, default=100)
    parser.add_argument("--bad", type=int, default=40)
    parser.add_argument("--first", type=int, default=10_000)
    parser.add_argument(
        "--winch", action="store_true", help="by winch; failures: jammed, half released, lost on the way"
    )
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--output", type=Path, default=Path("out/proof.jsonl"), help="each run, as soon as it is judged"
    )
    given = parser.parse_args()
    pilots = ("px4", "ardupilot")
    cases = [(given.first + n, pilots[n % 2], "") for n in range(given.good)]
    failures = ("jammed", "half", "jammed", "early") if given.winch else FAILURES[:4]
    cases += [(given.first + n, pilots[n % 2], failures[n // 2 % len(failures)]) for n in range(given.bad)]
    given.output.parent.mkdir(parents=True, exist_ok=True)
    runs = []
    cases.sort(key=lambda case: case[0])
    with ProcessPoolExecutor(given.workers) as pool, given.output.open("w", encoding="utf-8") as file:
        for run in pool.map(_by_winch if given.winch else _one, cases, chunksize=4):
            runs.append(run)
            file.write(json.dumps(dataclasses.asdict(run)) + "\n")
            file.flush()
    good = [run for run in runs if not run.failure]
    bad = [run for run in runs if run.failure]
    alarms = [run for run in good if run.verdict != Verdict.DELIVERED]
    missed = [run for run in bad if run.verdict == Verdict.DELIVERED]
    print(f"{len(good)} good deliveries: {len(alarms)} false alarms {Counter(run.verdict for run in alarms)}")
    print(f"{len(bad)} failures: {len(missed)} missed; {Counter((run.failure, run.verdict) for run in bad)}")
    print(f"known at the latest {max((run.after_s for run in runs), default=0.0):.1f} s after the take-off")
    for run in (*alarms[:20], *missed[:20]):
        print(f"  {run}")


if __name__ == "__main__":
    main()
