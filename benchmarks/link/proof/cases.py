"""Deliveries of the evaluation: short ones, and long legs in gusts."""

from __future__ import annotations

import random

from benchmarks.link.proof.missions import leg
from benchmarks.link.proof.run import Heard, Run
from benchmarks.link.proof.stage import Stage
from skyway.calibration_flight import drag_of
from skyway.models.drones.drone import M200_V2
from skyway.sim_stub.faults import Fault

FAILURES = ("stuck", "early", "half", "silent", "jammed")
"""Acknowledged and not released; lost on the way; half of it released; the gripper does not move and reports that; a winch that jams."""
WINCH_EVERY = 5
"""One of this number of good deliveries is by winch."""
WAY_M, WAY_GUSTS = 4500.0, 7
"""Length of a long leg, and number of gusts on it."""


def deliver(
    seed: int, autopilot: str, failure: str = "", package_kg: float = 0.8, *, winch: bool = False, gusts: bool = False
) -> tuple[Run, Heard]:
    """Fly one delivery, and evaluate it; `gusts` adds a sudden gust on the way."""
    heard = Heard(seed, autopilot, winch or failure == "jammed", failure, package_kg)
    stage = Stage(heard, gusts=int(gusts))
    if heard.winch:
        stage.lower()
    else:
        stage.let_go()
    return stage.judged.run(), heard


def way(seed: int, autopilot: str, failure: str = "") -> tuple[Run, Heard]:
    """Fly a long leg in gusts, with a package of any weight, which may be lost on it."""
    luck = random.Random(f"way/{seed}")
    package_kg = round(luck.uniform(0.2, 1.2), 2)
    heard = Heard(seed, autopilot, winch=False, failure=failure, package_kg=package_kg, drag=drag_of(M200_V2, 0.8))
    stage = Stage(heard, gusts=WAY_GUSTS, over_s=WAY_M / 12.0)
    if failure:
        heard.lost_after_s = luck.uniform(30.0, WAY_M / 15.0)
        stage.craft.faults.add(Fault("package-lost", heard.lost_after_s, value=1.0, after_take_off=True), 0.0)
    stage.fly(leg(WAY_M), until_s=WAY_M / 12.0)
    return stage.judged.run(), heard
