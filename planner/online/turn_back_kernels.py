"""Kernels of flights that may turn back, as long as one end is certain to be reached.

Against the wind the way out is slow and the way back is fast, so for most of the way a drone can wait and see how the
gusts and the wind of the next hour turn out. It flies on while some plan reaches one end with the reserve, in all but a
share of what may come: on, back half a minute later, or on until the wind changes and then to either end. Without such
a plan it makes for the end with the lower risk.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.flight.kernels import NEVER, slot_end, slot_of
from skyway.models.jit.compiled import compiled, compiled_lean
from skyway.models.wind.gusts import gust_mean_variance
from skyway.models.wind.triangle import MIN_GROUND_SPEED_MPS
from skyway.planner.robust.normal_kernels import capped
from skyway.planner.robust.uncertain_wind_kernels import gust_mean, wind_felt, wind_variance
from skyway.planner.schedule.gust_kernels import GUST_STEP_S, GustyPlace, gusts_of, gusty_part, gusty_speed, gusty_start

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.flight.rules import SegmentWind
    from skyway.planner.robust.information_kernels import Known


class TurnBack(NamedTuple):
    """Rule of turning back for a flight over one segment."""

    back: int
    """The same segment the other way."""
    risk: float
    """Chance to land below the reserve with which it may go on."""
    deviations: float
    """Standard deviations of a mean gust that are exceeded with that chance."""
    reserve: float
    """To land with, SoC."""
    soc_per_s: float
    soc_fixed: float
    """What a flight is believed to take, at most."""
    gust_sd: float
    gust_time_s: float
    """Of gusts, see `planner.schedule.gust_kernels.Disturbance`."""
    later_out_mps: NDArray[np.float64]
    later_out_sd: NDArray[np.float64]
    later_back_mps: NDArray[np.float64]
    later_back_sd: NDArray[np.float64]
    """Shape (members,) each. Ground speeds either way once the wind has changed, and their standard deviations; see
    `later_speeds`."""
    likelihood: NDArray[np.float64]
    """Shape (members,). Probability of each."""


@compiled
def later_speeds(
    known: Known, slot: int, segment: int, flight_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ground speed over a segment in a slot by each member, and its standard deviation, shape (members,); m/s.

    sqrt(g^2 f^2 + variance): g the deviation of the mean of the gusts of a flight, f what a gust of the wind's own
    strength does, and the variance by which the wind is less sure than the members say (see `Known`).

    Takes a slot and a segment of the air of `known`, and any length of flight.
    """
    air = known.air
    gust = gust_mean(known, flight_s)
    unsure = wind_variance(known, air.slot_s)
    mean, deviation = np.empty(len(air.north)), np.empty(len(air.north))
    for member in range(len(mean)):
        speed, with_wind, across_wind = wind_felt(air, member, slot, segment)
        felt = math.hypot(with_wind, across_wind)
        mean[member], deviation[member] = speed, math.sqrt(gust * gust * felt * felt + unsure)
    return mean, deviation


@compiled_lean
def _later_risk(way_m: float, within_s: float, mean: float, deviation: float, most_mps: float) -> float:
    """Chance that a way takes longer than it may at a speed that is normally distributed, but never above a limit.

    P(V < way / within), V ~ Normal(mean, deviation^2) in m/s; 1 where even the greatest speed is too slow.
    """
    if way_m <= 0.0:
        return 0.0 if within_s >= 0.0 else 1.0
    if within_s <= 0.0:
        return 1.0
    least = way_m / within_s
    if least > most_mps:
        return 1.0
    return 0.5 * math.erfc((mean - least) / max(deviation, 1e-6) * math.sqrt(0.5))


@compiled_lean
def _takes_s(
    air: SegmentWind,
    member: int,
    slot: int,
    segment: int,
    left_m: float,
    gust: tuple[float, float],
    ahead_s: float,
    deviations: float,
    how: TurnBack,
) -> float:
    """How long the last metres of a segment take if the mean gust is some deviations against it, s.

    They start in `ahead_s`. The present gust, x_0, fades as exp(-t / tau). With tau = x T, the mean over a flight of
    T that begins with it has the mean q x_0, q = x (1 - exp(-1 / x)) exp(-ahead / tau), and the variance V(x) - q^2
    (`gust_mean_variance`), in standard deviations of gusts. So the speed changes by what q x_0 does to it (`wind_felt`)
    and is slower by `deviations` of the rest; about their mean the gusts still vary by 1 - (V - q^2), of which the
    greatest ground speed cuts off the gain (`capped`).

    `gust` is x_0 along and across the wind; `air`, `member`, `slot` and `segment` say where.
    """
    speed, with_wind, across_wind = wind_felt(air, member, slot, segment)
    flight_s = left_m / max(speed, MIN_GROUND_SPEED_MPS)
    # q (`kept`) and V - q^2.
    x = how.gust_time_s / max(flight_s, 1.0)
    kept = x * (1.0 - math.exp(-1.0 / x)) * math.exp(-ahead_s / how.gust_time_s)
    square = max(gust_mean_variance(x) - kept * kept, 0.0)
    # The speed with the present gust, less the deviations, and capped.
    felt = how.gust_sd * math.hypot(with_wind, across_wind)
    drift = how.gust_sd * kept * (gust[0] * with_wind - gust[1] * across_wind)
    slow = speed + drift - deviations * felt * math.sqrt(square)
    slow = capped(slow, felt * math.sqrt(max(1.0 - square, 0.0)), air.max_ground_speed_mps)
    return left_m / max(slow, MIN_GROUND_SPEED_MPS)


@compiled_lean
def out_or_back(
    air: SegmentWind,
    member: int,
    segment: int,
    depart_s: float,
    charge: float,
    energy: float,
    key: np.uint64,
    how: TurnBack,
) -> tuple[float, bool]:
    """Touch-down of a flight over a segment, or of its return: (POSIX seconds, whether it turned back).

    Flown in steps of `GUST_STEP_S`; before each step on the way out it decides whether to turn (`_turns`).

    Takes a segment of the air with a way back, and a finite take-off and charge.

    Parameters
    ----------
    depart_s, charge : float
        Take-off, POSIX seconds, and charge then.
    energy : float
        What the vehicle takes, as a multiple of what it is believed to take.
    key : uint64
        Of its gusts. It lands before the wind has changed twice.
    """
    gusts = gusts_of(key, how.gust_sd, how.gust_time_s)
    at = gusty_start(gusts, air.distance_m[segment], depart_s + air.climb_s)
    way = segment
    first = slot_of(air, depart_s)
    while at.left_m > 0.0:
        left, now, step, gust = at
        slot = slot_of(air, now)
        if way == segment:
            # How long the charge lasts above the reserve, when the wind changes, and whether it turns now.
            taken = energy * (how.soc_fixed + how.soc_per_s * (now - depart_s))
            until = now + (charge - taken - how.reserve) / how.soc_per_s - air.descent_s
            change = slot_end(air, slot) if slot == first else NEVER
            speed = gusty_speed(air, member, slot, segment, gust, how.gust_sd)
            if left > speed * GUST_STEP_S and _turns(
                air, member, slot, segment, (now, left, speed), gust, until, change, how
            ):
                at = GustyPlace(air.distance_m[segment] - left, now, step, gust)
                way = how.back
        # On to the end of the gust, of the slot or of the way.
        at = gusty_part(air, member, way, gusts, at)
    return at.time_s + air.descent_s, way != segment


@compiled_lean
def _turns(
    air: SegmentWind,
    member: int,
    slot: int,
    segment: int,
    at: tuple[float, float, float],
    gust: tuple[float, float],
    until: float,
    change: float,
    how: TurnBack,
) -> bool:
    """Whether a flight turns now: no other plan is sure enough to reach one end in time, and back is surer than out.

    Plans are to fly on; to turn half a minute later; and to fly on until the wind changes, and then to the end that is
    reached in the new one. `at` is the time, the metres left and the ground speed; the wind changes at `change`. What
    comes before that is flown in nearly the worst gusts. The charge lasts until `until`; a plan is sure enough if it
    takes longer with the chance `how.risk` at most, over the members of the new wind.
    """
    now, left, speed = at
    flown = air.distance_m[segment] - left
    turn = now + GUST_STEP_S
    further = flown + speed * GUST_STEP_S
    # In the present wind: on, back in half a minute, back now.
    out_s = _takes_s(air, member, slot, segment, left, gust, 0.0, how.deviations, how)
    back_s = _takes_s(air, member, slot, how.back, further, gust, GUST_STEP_S, how.deviations, how)
    here_s = _takes_s(air, member, slot, how.back, flown, gust, 0.0, how.deviations, how)
    # All before the wind changes: these times decide.
    if now + out_s <= change and turn + back_s <= change:
        return min(now + out_s, turn + back_s) > until and here_s < out_s
    # Else: where each plan is when it changes, and what is left then. `far` is the way back from out there.
    usual_s = _takes_s(air, member, slot, segment, left, gust, 0.0, 0.0, how)
    far = min(flown + left * (change - now) / usual_s + speed * GUST_STEP_S, air.distance_m[segment])
    later_out, out_from = _after(now, left, out_s, change)
    later_back, back_from = _after(turn, further, back_s, change)
    later_here, here_from = _after(now, flown, here_s, change)
    # The chance, over the members of the new wind, that each of them takes too long.
    most = air.max_ground_speed_mps
    risk_out, risk_back, risk_then, risk_here = 0.0, 0.0, 0.0, 0.0
    for m in range(len(how.likelihood)):
        chance = how.likelihood[m]
        out = _later_risk(later_out, until - out_from, how.later_out_mps[m], how.later_out_sd[m], most)
        mean, deviation = how.later_back_mps[m], how.later_back_sd[m]
        risk_out += chance * out
        risk_back += chance * _later_risk(later_back, until - back_from, mean, deviation, most)
        risk_here += chance * _later_risk(later_here, until - here_from, mean, deviation, most)
        risk_then += chance * min(out, _later_risk(far, until - change, mean, deviation, most))
    return min(risk_out, risk_back, risk_then) > how.risk and risk_here < risk_out


@compiled_lean
def _after(now: float, way_m: float, takes_s: float, change: float) -> tuple[float, float]:
    """What is left of a way when the wind changes, m, and from when on: before that it would take so long as a whole.

    0 m, and the time it ends, where it ends before. At an even speed, way (1 - (change - now) / takes).
    """
    if now + takes_s <= change:
        return 0.0, now + takes_s
    return way_m * (1.0 - max(change - now, 0.0) / takes_s), max(change, now)


@compiled
def trials(
    air: SegmentWind,
    members: NDArray[np.int64],
    segment: int,
    depart_s: float,
    charge: float,
    energies: NDArray[np.float64],
    keys: NDArray[np.uint64],
    how: TurnBack,
) -> tuple[float, float, float]:
    """Fly in many winds and gusts: share that gets there; of the others the mean time, s, and SoC on landing.

    Takes members of the air, with an energy and a key for each.

    Parameters
    ----------
    members, energies, keys : ndarray, shape (flights,)
        Member of the wind, energy as a multiple of what is believed, and key of the gusts of each.
    segment, depart_s, charge
        As of `out_or_back`.
    """
    away, back_s, soc = 0, 0.0, 0.0
    for k in range(len(keys)):
        down, turned = out_or_back(air, members[k], segment, depart_s, charge, energies[k], keys[k], how)
        if turned:
            away += 1
            back_s += down - depart_s
            soc += charge - energies[k] * (how.soc_fixed + how.soc_per_s * (down - depart_s))
    return 1.0 - away / len(keys), back_s / max(away, 1), soc / max(away, 1)
