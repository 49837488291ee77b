"""Flights made up for the voltage: climb, level flight, gusts, a turn, a descent, by a battery that is sound or fails.

The battery is the simulator's, whose curve is not the one that is judged by; power, gusts and what is known of the load have errors
of their own.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from skyway.link.supervisor.soc.voltage import VoltageWatch
from skyway.models.drones.charging import ChargingCurve
from skyway.sim_stub.plant.battery import Battery

CAPACITY_J = 350.0 * 3600.0
HOVER_W = 850.0
LANDING_S = 45.0
LAND_BELOW = 0.1
"""Charge below which the supervisor says that there is no time to doubt."""
MOMENTS_S = {
    "take-off": 3.0,
    "climb": 12.0,
    "end of the climb": 21.0,
    "level": 90.0,
    "gust": 150.0,
    "turn": 210.0,
    "descent": 290.0,
}
"""When a fault begins, after the take-off."""


@dataclass(frozen=True)
class Flown:
    """What became of a loss, second by second from the take-off on.

    Attributes
    ----------
    lost : list of float
        What the watch holds for lost.
    doubted : list of bool
        Whether it doubts that.
    soc : list of float
        True state of charge.
    """

    lost: list[float]
    doubted: list[bool]
    soc: list[float]


def _phase(second: float, gust_w: float, luck: random.Random) -> tuple[float, float]:
    """Power over that of hover, and what is known of it, without the gusts."""
    known = 1.28 if second < 20.0 else 0.94 if second < 210.0 else 1.12 if second < 280.0 else 0.85
    true = 1.33 if second < 20.0 else 0.98 if second < 210.0 else 1.10 if second < 280.0 else 0.90
    if 150.0 <= second < 170.0:
        true *= 1.12
    return true * (1.0 + gust_w + luck.gauss(0.0, 0.01)), known


def fly(
    seed: int, *, soc: float = 1.0, factor: float = 1.0, packets: int = 0, at_s: float = 0.0, left: float | None = None,
    gusts: float = 0.05, seconds: int = 340, current_factor: float = 1.0,
) -> Flown:  # fmt: skip
    """Fly with a voltage that is told wrongly for some packets, or with a battery that has `left` from a moment on."""
    luck, watch = random.Random(seed), VoltageWatch()
    battery = Battery(CAPACITY_J, ChargingCurve(3600.0), soc)
    told, gust, start_s = soc, 0.0, 1_000.0
    flown = Flown([], [], [])
    volts = amperes = 0.0
    for half in range(-60, 2 * seconds):
        second = 0.5 * half
        if second < 0.0:
            battery.current_a, known = 0.6, 1.0
        else:
            gust += 0.5 / 8.0 * -gust + math.sqrt(2.0 * 0.5 / 8.0) * gusts * luck.gauss(0.0, 1.0)
            power, known = _phase(second, gust, luck)
            if left is not None and second == at_s:
                battery.soc = left
            battery.discharge(HOVER_W * power, 0.5)
            told -= HOVER_W * power * 0.5 / CAPACITY_J
        if half % 2 == 0:  # told once a second, looked at twice
            volts, amperes = battery.voltage_v + luck.gauss(0.0, 0.01), battery.current_a + luck.gauss(0.0, 0.2)
            if packets and 0 <= second - at_s < packets:
                volts, amperes = volts * factor, amperes * current_factor
        watch.hear(start_s + second, volts, amperes, math.floor(100.0 * told) / 100.0, load=known, flies=second > 2.0)
        if second >= 0.0 and half % 2 == 0:
            flown.lost.append(watch.lost)
            flown.doubted.append(watch.doubtful(affordable=told - watch.lost > LAND_BELOW))
            flown.soc.append(battery.soc)
    return flown
