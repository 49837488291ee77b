"""Far deliveries for the proof: minutes of cruise in strong wind, speeds that are changed on the way, weak batteries, packages of any weight.

Each is another: one flight of 2 to 5 km, or two with a stop and a full battery between them; up to 14 m/s of wind at the cruise height, head, tail or cross, which grows with height like a power
with an exponent of 0.05 to 0.3 and is believed as in a supervised flight; one to three changes of the airspeed, to 10 to 22 m/s; 0.2 to 1.2 kg, whose drag is not quite the
calibrated one; a third of the batteries hold 10 % less. A fifth lowers its package by winch. What fails is that of `benchmarks.link.proof`; losses at any time of the last flight. ``python -m
benchmarks.link.proof --far N``.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from benchmarks.link.proof.cases import WINCH_EVERY
from benchmarks.link.proof.missions import HEIGHT_M, leg
from benchmarks.link.proof.run import Heard, Run
from benchmarks.link.proof.stage import Stage
from skyway.calibration_flight import drag_of
from skyway.models.drones.drone import M200_V2
from skyway.sim_stub.faults import Fault
from skyway.sim_stub.plant.wind_truth import ConstantWind

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.models.drones.drag import DragModel

NEAREST_M, FARTHEST_M = 2_000.0, 5_000.0
STRONGEST_MPS = 14.0
SLOWEST_MPS, FASTEST_MPS, LEAST_OVER_GROUND_MPS = 10.0, 22.0, 6.0
STOP_S = 60.0
_LOWEST_M = 2.0


@dataclass(frozen=True)
class Sheared:
    """A wind that grows with height."""

    aloft: ConstantWind
    """At the cruise height."""
    exponent: float

    def at(self, posix_s: float, lat: float, lon: float, height_m: float) -> tuple[float, float]:
        """(north, east) m/s towards."""
        factor = (max(height_m, _LOWEST_M) / HEIGHT_M) ** self.exponent
        north, east = self.aloft.at(posix_s, lat, lon, height_m)
        return factor * north, factor * east


@cache
def calibrated() -> DragModel:
    """Drag of the drone, under a package that is not quite the one that it carries."""
    return drag_of(M200_V2, 0.8)


def far(seed: int, autopilot: str, failure: str = "", *, winch: bool | None = None) -> tuple[Run, Heard]:
    """Fly one far delivery, and judge it."""
    luck = random.Random(f"far/{seed}")
    package_kg = round(luck.uniform(0.2, 1.2), 2)
    way_m, flights = luck.uniform(NEAREST_M, FARTHEST_M), luck.choice((1, 2))
    aloft = ConstantWind.of(luck.uniform(0.0, STRONGEST_MPS), luck.uniform(0.0, 360.0))
    lowers = failure == "jammed" or (failure not in ("stuck", "silent") and luck.random() < 1.0 / WINCH_EVERY)
    lowers = lowers if winch is None else winch
    heard = Heard(seed, autopilot, winch=lowers, failure=failure, package_kg=package_kg, drag=calibrated())
    fast = (("WPNAV_SPEED", 100.0 * FASTEST_MPS), ("MPC_XY_VEL_MAX", FASTEST_MPS), ("MPC_XY_CRUISE", 15.0))
    known = {"ardupilot": fast[:1], "px4": fast[1:]}[autopilot]
    stage = Stage(heard, wind=Sheared(aloft, luck.uniform(0.05, 0.3)), parameters=known)
    now = stage.craft.faults
    if luck.random() < 0.35:
        now.add(Fault("battery-weak", value=0.9), 0.0)
    kinds = {"stuck": ("gripper-stuck", 1.0), "half": ("gripper-stuck", 0.5), "silent": ("gripper-silent", 1.0)}
    if failure in kinds:
        now.add(Fault(kinds[failure][0], value=kinds[failure][1]), 0.0)
    if failure == "jammed":
        now.add(Fault("winch-jammed", value=luck.uniform(0.5, 12.0)), 0.0)

    def lose() -> None:
        if stage.releasing:
            return
        heard.lost_after_s = stage.judged.now_s - stage.judged.took_off_s
        now.add(Fault("package-lost", value=1.0), stage.world.sim_s)

    if flights == 2:
        stage.fly(leg(way_m), acts=_speeds(luck, stage, aloft.north_mps, way_m))
        stage.craft.battery.soc = 1.0
        stage.connection.run_for(STOP_S)
    back = flights == 2
    acts = _speeds(luck, stage, -aloft.north_mps if back else aloft.north_mps, way_m)
    if failure == "early":
        acts.append((luck.uniform(24.0, 40.0 + way_m / 12.0), lose))
    (stage.lower if lowers else stage.let_go)(way_m, sorted(acts, key=lambda one: one[0]), back=back)
    if failure == "early" and heard.lost_after_s is None:
        heard.failure = ""  # it had landed, or hung on the line, before
    return stage.judged.run(), heard


def _speeds(
    luck: random.Random, stage: Stage, ahead_mps: float, way_m: float
) -> list[tuple[float, Callable[[], None]]]:
    """Airspeeds that are ordered on the way."""
    found = []
    for _ in range(luck.randint(1, 3)):
        over_ground = max(luck.uniform(SLOWEST_MPS, FASTEST_MPS) + ahead_mps, LEAST_OVER_GROUND_MPS)
        found.append((luck.uniform(20.0, way_m / 15.0), lambda mps=over_ground: stage.vehicle.change_speed(mps)))
    return sorted(found, key=lambda one: one[0])
