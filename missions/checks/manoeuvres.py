"""Manoeuvres: the time and energy of a flight beyond its straight hops: acceleration, braking, turns, and the last metres of a landing.

A change of velocity dv at the acceleration a costs dv / 2a beyond flying by: in its duration, half the distance is covered. A vehicle that
holds somewhere stops there; one that only turns changes as much velocity as its direction.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.missions.checks.hops import SAME_PLACE_M
from skyway.models.flight.rules import STEP_MPS2

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.missions.checks.hops import Hops

LIFT_OFF_S = 3.0
"""Time for motors to spin up, and for the climb to accelerate."""
TOUCH_DOWN_S = 12.0
"""The last metres are descended slowly: ArduPilot's 10 m at LAND_SPEED, 0.5 m/s, take 17 s longer than at 3 m/s, PX4's, slower from 10 to 5 m and 0.7 m/s
from there (MPC_LAND_SPEED), 7 s."""


def turn_s(speed_mps: float) -> float:
    """Additional time of accelerating to a speed, or of braking from it."""
    return 0.5 * speed_mps / STEP_MPS2


def manoeuvres_s(
    hops: Hops, most_mps: float, *, lifts_off: bool = True, touches_down: bool = True
) -> NDArray[np.float64]:
    """Seconds of manoeuvres of hops that are flown one after the other, shape (hops,): those at the end of each, and at the beginning of the first.

    `most_mps` is the vehicle's greatest speed. Stops for a climb are already in the hops (`checks.energy.hops_of_leg`).
    """
    moves = hops.length_m > SAME_PLACE_M
    speed = np.where(moves, np.minimum(hops.speed_mps, most_mps), 0.0)
    angle = np.radians(hops.bearing_deg)
    velocity = np.concatenate(([0.0], speed * np.exp(1j * angle), [0.0]))
    holds = hops.hold_s > 0.0
    stops = np.concatenate(([True], holds[:-1], [True]))  # before each hop, and after the last one
    change = np.where(stops, np.abs(velocity[:-1]) + np.abs(velocity[1:]), np.abs(np.diff(velocity)))
    # braking and accelerating for a climb between two ways is in its hold
    inside = np.flatnonzero(~moves[1:-1] & (hops.climb_s + hops.descent_s > 0.0)[1:-1] & ~hops.apart[1:-1]) + 1
    inside = inside[moves[inside - 1] & moves[inside + 1]]
    change[inside] = change[inside + 1] = 0.0
    found = 0.5 * change / STEP_MPS2
    seconds = found[1:].copy()
    seconds[0] += found[0]
    seconds[0] += LIFT_OFF_S * lifts_off
    seconds[-1] += TOUCH_DOWN_S * touches_down
    return np.asarray(seconds)
