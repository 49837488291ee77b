"""A simulated vehicle with its package, and the proof of its delivery."""

from __future__ import annotations

import math
import random
from typing import TYPE_CHECKING

from benchmarks.link.proof.missions import HEIGHT_M, LAT, LEG_M, LON, leg, lowering
from benchmarks.link.proof.run import Judged
from skyway.link.protocol.connection import Connection
from skyway.link.supervisor.flight.release import HANGS_S, LINE_M
from skyway.link.vehicle.vehicle import Vehicle
from skyway.missions.builder.release_items import release_range
from skyway.models.base.errors import LinkError
from skyway.models.composition.release import WINCH_HEIGHT_M, winch_s
from skyway.models.wind.estimation.live import LiveWind
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.faults import Fault
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.lockstep import Lockstep
from skyway.sim_stub.world import World

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from benchmarks.link.proof.run import Heard
    from skyway.missions.items.mission import Mission
    from skyway.models.drones.telemetry import TelemetrySample
    from skyway.sim_stub.plant.wind_truth import WindTruth

    Acts = Sequence[tuple[float, Callable[[], None]]]
    """Actions, each with its time after a take-off, s."""

GROUND_M = 5.0
AFTER_S = 18.5
"""Time after a take-off at which the result is due, s."""


class Stage:
    """One simulated vehicle with its package, and the proof of its delivery."""

    def __init__(
        self,
        heard: Heard,
        *,
        gusts: int = 0,
        over_s: float = 60.0,
        wind: WindTruth | None = None,
        parameters: tuple[tuple[str, float], ...] = (),
    ) -> None:
        seed, autopilot, failure = heard.seed, heard.autopilot, heard.failure
        self.rng = rng = random.Random(f"{'winch/' if heard.winch else ''}{seed}/{autopilot}/{failure}")
        wind_mps, towards = rng.uniform(0.0, 9.0), rng.uniform(0.0, 360.0)
        faults = () if heard.drag else _faults(failure, rng)
        heard.lost_after_s = faults[0].start_s if faults and failure == "early" else None
        ardupilot = (("GRIP_ENABLE", 1.0), ("WINCH_TYPE", float(rng.choice((1, 2)))))
        gripper = ardupilot if autopilot == "ardupilot" else (("PD_GRIPPER_EN", 1.0),)
        self.off = rng.gauss(0.0, 0.8), rng.gauss(0.0, 0.8)
        """Error of the wind given to the scale, (north, east), m/s."""
        for _ in range(gusts):
            begins_s = rng.uniform(5.0, over_s)
            gust = Fault(
                "gust", begins_s, begins_s + rng.uniform(8.0, 60.0), rng.uniform(3.0, 9.0), after_take_off=True
            )
            faults = (*faults, gust)
        blows = wind or ConstantWind.of(wind_mps, towards)
        self.world = World(wind=blows, faults=faults)
        self.craft = self.world.add(
            VehicleConfig(
                lat=LAT, lon=LON, ground_m=GROUND_M, autopilot=autopilot, seed=seed, warm=True,
                payload_kg=heard.package_kg, parameters=(*gripper, *parameters),
            )
        )  # fmt: skip
        lockstep = Lockstep(self.world)
        self.connection = Connection(lockstep.connect(self.craft, seed=seed), lockstep.clock)
        self.vehicle = Vehicle(self.connection)
        self.vehicle.request_telemetry()
        self.judged = Judged(heard)
        self.releasing = False
        """The vehicle hovers to lower the package."""
        self.wind: LiveWind | None = None
        """Estimates the wind as a supervised flight does; None: the true wind with an error is used."""
        if heard.drag is not None:
            north, east = blows.at(0.0, LAT, LON, HEIGHT_M)
            expected = north + 2.0 * self.off[0], east + 2.0 * self.off[1]
            self.wind = LiveWind(drag=heard.drag, forecast=lambda *_: expected)

    def _air(self, s: TelemetrySample) -> tuple[float, float]:
        if self.wind is None:
            north, east = self.craft.true_wind
            return north + self.off[0], east + self.off[1]
        if s.landed == 0.0 and s.height_m > 0.6 * HEIGHT_M:
            self.wind.hear(s)
        now = self.wind.estimate
        return (0.0, 0.0) if now is None or now.source == "inconsistent" else (now.north_mps, now.east_mps)

    def _samples(self, seconds: float) -> Iterator[TelemetrySample]:
        for s in self.vehicle.samples(seconds):
            self.judged.hear(s, self._air(s))
            yield s

    def lower(self, north_m: float = LEG_M, acts: Acts = (), *, back: bool = False) -> None:
        """Fly out, lower the package and leave; ends when the result is due."""
        vehicle, clock, judged = self.vehicle, self.connection.clock, self.judged
        mission = lowering(north_m, back=back)
        assert vehicle.upload(mission).verified
        vehicle.start(60.0)
        first, last = release_range(mission.items) or (0, 0)
        begun_s, line_m, asked, weighed = math.nan, None, False, False
        end, due, set_off_s = clock.now_s() + 3600.0, list(acts), math.nan
        while clock.now_s() < end:
            self._act(due, set_off_s)
            if math.isnan(set_off_s) and self.craft.body.up_mps > 0.3:
                set_off_s = judged.now_s
            for s in self._samples(0.5):
                if s.time_s > judged.left_s + AFTER_S:
                    return
            said = vehicle.peer.latest.get("MISSION_CURRENT")
            item = -1 if said is None else said["seq"] - vehicle.family.home_items
            if math.isnan(begun_s) and item >= first:
                begun_s, self.releasing = clock.now_s(), True
                judged.tell("begins_release", watched=True)
            if not weighed and clock.now_s() > begun_s + HANGS_S:
                judged.tell("before_release")
                weighed = True
            if not asked and clock.now_s() > begun_s + winch_s() - 5.0:
                line_m, asked = vehicle.winch_line_m(), True
            if math.isnan(judged.left_s) and item > last:
                lowered = None if line_m is None else line_m >= WINCH_HEIGHT_M - LINE_M
                judged.tell("released", acknowledged=lowered, how="the winch")
                judged.tell("leaves", hovered=True)
        raise RuntimeError("it did not leave")

    def _act(self, due: list[tuple[float, Callable[[], None]]], took_off_s: float) -> None:
        """Execute the actions due after a take-off."""
        while due and self.judged.now_s > took_off_s + due[0][0]:
            due.pop(0)[1]()

    def fly(self, mission: Mission, until_s: float = math.inf, acts: Acts = ()) -> None:
        """Fly until the vehicle has landed, or for a time after its take-off; `acts` in the order of time."""
        vehicle, clock = self.vehicle, self.connection.clock
        assert vehicle.upload(mission).verified
        vehicle.start(60.0)
        took_off_s, end, due = math.nan, clock.now_s() + 3600.0, list(acts)
        while clock.now_s() < end:
            self._act(due, took_off_s)
            for s in self._samples(0.5):
                if math.isnan(took_off_s) and s.height_m > 0.3:
                    took_off_s = s.time_s
                if s.time_s > took_off_s + until_s:
                    return
            if not math.isnan(took_off_s) and not vehicle.armed:
                return
        raise RuntimeError("it did not land")

    def let_go(self, north_m: float = LEG_M, acts: Acts = (), *, back: bool = False) -> None:
        """Fly out, land, release the package, and begin the way back."""
        self.fly(leg(north_m, back=back), acts=acts)
        self.judged.tell("before_release")
        self.connection.run_for(20.0)
        if self.rng.random() < 0.5:  # another wind on departure
            self.craft.faults.add(Fault("wind-shift", value=self.rng.uniform(0.0, 4.0)), self.world.sim_s)
        acknowledged = True
        try:
            self.vehicle.release()
        except LinkError:
            acknowledged = False
        self.judged.tell("released", acknowledged=acknowledged)
        if acknowledged:
            self.fly(leg(north_m, back=not back), until_s=AFTER_S)


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
