"""The truth that filters are judged by: a point mass with drag in a wind that wanders, and what its sensors would say.

Its own equations, on purpose: nothing of `models.drones.drag` or of the filter is used here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from skyway.models.drones.telemetry import TelemetryTrack

G = 9.80665
RATE_HZ = 10.0


@dataclass(frozen=True)
class Truth:
    """Many runs of one flight.

    Attributes
    ----------
    time_s : ndarray, shape (steps,)
    velocity, wind : ndarray, shape (steps, runs, 2)
        (north, east), m/s; the wind TOWARDS.
    tilt : ndarray, shape (steps, runs, 2)
        Horizontal acceleration of the thrust, (north, east), m/s2, as the attitude shows it.
    """

    time_s: np.ndarray
    velocity: np.ndarray
    wind: np.ndarray
    tilt: np.ndarray

    def track(self, run: int) -> TelemetryTrack:
        """Telemetry of one run, the nose to the north."""
        north, east = self.tilt[:, run].T / G
        pitch = -np.arctan(north)
        roll = np.arctan(east * np.cos(pitch))
        count = len(self.time_s)
        return TelemetryTrack.of_columns(
            1,
            self.time_s,
            {
                "vel_north_mps": self.velocity[:, run, 0],
                "vel_east_mps": self.velocity[:, run, 1],
                "vel_down_mps": np.zeros(count),
                "roll_rad": roll,
                "pitch_rad": pitch,
                "yaw_rad": np.zeros(count),
                "height_m": np.full(count, 60.0),
                "landed": np.zeros(count),
                "fixed_wing": np.zeros(count),
                "lat_deg": np.full(count, 47.0),
                "lon_deg": np.full(count, 8.0),
            },
        )


def ou(generator, steps, runs, dt, tau_s, sigma_mps):
    """Ornstein-Uhlenbeck winds, shape (steps, runs, 2), stationary from the start."""
    keep = math.exp(-dt / tau_s)
    out = np.empty((steps, runs, 2))
    out[0] = generator.normal(0.0, sigma_mps, (runs, 2))
    shocks = generator.normal(0.0, sigma_mps * math.sqrt(1.0 - keep**2), (steps, runs, 2))
    for step in range(1, steps):
        out[step] = keep * out[step - 1] + shocks[step]
    return out


def fly(
    *,
    seed=0,
    runs=1,
    duration_s=300.0,
    courses_deg=(0.0, 120.0, 240.0),
    leg_s=60.0,
    speed_mps=16.0,
    mean=(-4.0, 3.0),
    tau_s=600.0,
    sigma_mps=2.5,
    c1=0.15,
    c2=0.010,
    gust_intensity=0.14,
    gust_tau_s=12.0,
    tilt_sigma_mps2=0.35,
    velocity_sigma_mps=0.03,
    shift=None,
    bias=(0.0, 0.0),
) -> Truth:
    """Fly legs on courses in turn at a ground speed, in a wind that wanders and gusts about that.

    `shift` = (time, north, east) adds to the wind from then on.
    """
    generator = np.random.default_rng(seed)
    dt = 1.0 / RATE_HZ
    steps = round(duration_s * RATE_HZ)
    time_s = 1_700_000_000.0 + np.arange(steps) * dt
    wind = np.array(mean) + ou(generator, steps, runs, dt, tau_s, sigma_mps)
    if shift is not None:
        wind[np.arange(steps) * dt >= shift[0]] += np.array(shift[1:])
    speed = np.hypot(wind[..., 0], wind[..., 1])[..., None]
    wind += gust_intensity * speed * ou(generator, steps, runs, dt, gust_tau_s, 1.0)
    number = (np.arange(steps) * dt // leg_s).astype(int) % len(courses_deg)
    course = np.radians(np.array(courses_deg))[number]
    wanted = speed_mps * np.stack([np.cos(course), np.sin(course)], axis=1)
    velocity = np.empty((steps, 2))
    acceleration = np.empty((steps, 2))
    now = wanted[0].copy()
    for step in range(steps):
        velocity[step] = now
        push = (wanted[step] - now) / 1.0
        size = np.hypot(*push)
        acceleration[step] = push * min(1.0, 2.5 / max(size, 1e-9))
        now = now + acceleration[step] * dt
    air = velocity[:, None] - wind
    drag = air * (c1 + c2 * np.hypot(air[..., 0], air[..., 1])[..., None])
    tilt = drag + acceleration[:, None] + np.array(bias) + generator.normal(0.0, tilt_sigma_mps2, (steps, runs, 2))
    seen = velocity[:, None] + generator.normal(0.0, velocity_sigma_mps, (steps, runs, 2))
    return Truth(time_s, seen, wind, tilt)
