"""Time and energy of the work: a hop from every point to the next, and the charge of hops."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.missions.checks.energy import hops_of_leg
from skyway.missions.checks.hops import Hops, hop_times
from skyway.models.flight.energy import FlightPower

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.missions.checks.energy import FlightConditions
    from skyway.missions.recharge.work import Work


def work_hops(work: Work, conditions: FlightConditions) -> tuple[Hops, NDArray[np.float64]]:
    """Return the hop from every point of the work to the next, and the package carried on it, kg."""
    parts: list[Hops] = []
    payload: list[float] = []
    height_m, released = 0.0, False
    for leg in work.route.legs:
        if leg.steps:
            parts.append(hops_of_leg(work.mission, leg, conditions, height_m))
            payload += leg.payloads_kg(0.0 if released else conditions.payload_kg)
        released = released or leg.released or leg.released_after is not None
        height_m = leg.next_ground_m
    whole = Hops(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    before = np.array([0.0 if point.share == 1.0 else point.share for point in work.points[:-1]])
    steps = np.array([point.step for point in work.points[1:]])
    shares = np.array([point.share for point in work.points[1:]])
    begins = np.where(np.array([point.step for point in work.points[:-1]]) == steps, before, 0.0)
    part = shares - begins
    split = whole._replace(
        **{name: getattr(whole, name)[steps] * part for name in ("length_m", "climb_s", "descent_s")},
        **{name: getattr(whole, name)[steps] for name in ("lat", "lon", "bearing_deg", "speed_mps", "apart", "above_ground_m")},
        hold_s=np.where(shares == 1.0, whole.hold_s[steps], 0.0),
    )  # fmt: skip
    return split, np.array(payload)[steps]


def times_and_charges(
    hops: Hops, payload_kg: NDArray[np.float64], conditions: FlightConditions, at_s: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return seconds and charge of hops that start at some times, each of shape (times, hops).

    For several winds, the mean over those in which a hop is flyable; infinite if there are none.
    """
    weight = conditions.weather.probability
    times, charges = np.empty((len(at_s), len(hops.length_m))), np.empty((len(at_s), len(hops.length_m)))
    drone = conditions.drone
    of_payload = {mass: FlightPower.of(drone, mass) for mass in np.unique(payload_kg).tolist()}
    climb_w, cruise_w, descent_w = (
        np.array([getattr(of_payload[mass], f"{phase}_w") for mass in payload_kg.tolist()])
        for phase in ("climb", "cruise", "descent")
    )
    for number, now_s in enumerate(at_s.tolist()):
        elapsed = np.full((len(weight), len(hops.length_m)), now_s)
        in_each, _, _ = hop_times(hops, conditions, elapsed)
        flyable = np.isfinite(in_each)
        share = np.where(flyable, weight[:, None], 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = (share * np.where(flyable, in_each, 0.0)).sum(axis=0) / share.sum(axis=0)
        times[number] = np.where(np.isfinite(mean), mean, np.inf)
        cruise_s = np.where(np.isfinite(mean), mean, 0.0) - hops.climb_s - hops.descent_s
        joule = climb_w * hops.climb_s + descent_w * hops.descent_s + cruise_w * cruise_s
        charges[number] = np.where(np.isfinite(joule), joule, 0.0) / drone.battery_j
    return times, charges
