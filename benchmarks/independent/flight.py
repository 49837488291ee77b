"""One flight of each run: out piece by piece, on over stations or elsewhere as its policy says, down, and hovering until there is a place."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.independent.information import HERE, Aloft, Flown, Piece
from benchmarks.independent.telling import lines, reports, seen
from benchmarks.independent.vehicle.craft import cruise

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from benchmarks.independent.delivery import Run, Setting
    from benchmarks.independent.information import Leave, Policy

LOOK_M, LOOK_S, LEAST_M = 300.0, 20.0, 40.0
"""So often a drone looks whether to fly on: after the first or, at its last ground speed, the second, but not after less than the third. `fly` looks every ten
seconds, and counts on looking again within 45."""
HOVER_AIRSPEED_MPS = 3.0
NOWHERE = -1.0
"""Charge counted for a landing outside any station."""


@dataclass(eq=False)
class _Out:
    """A flight under way."""

    run: Run
    off_s: float
    way: tuple[int, ...]
    node: int
    """Landed at when it is not further: the last station that it was over."""
    flown: tuple[int, ...] = ()
    gone: float = 0.0
    """Share of the segment under way that lies behind, or lay where it was turned."""
    turned: int | None = None
    turned_at: NDArray[np.float64] | None = None
    """Where it was turned last."""
    pieces: list[Piece] = field(default_factory=list)
    speed_mps: float = math.inf
    """Over the ground, of the last piece."""

    @property
    def ends(self) -> bool:
        """Whether it is where it lands."""
        return self.turned is None and len(self.flown) == len(self.way)


def fly(setting: Setting, policy: Policy, going: dict[int, tuple[Leave, float]], runs: Sequence[Run], leg: int) -> None:
    """Take off, fly, land, hover until there is a place: all runs that go together, by their number."""
    gusts, air, how, ground = setting.gusts(leg), setting.air, setting.how, setting.ground
    share = setting.vehicle / setting.batteries.holds_j
    now = np.array([going[run.number][1] if run.number in going else run.time_s for run in runs])
    soc = np.array([run.soc for run in runs])
    outs = {n: _Out(runs[n], off, one.segments, runs[n].node) for n, (one, off) in going.items()}
    place = ground.xy[[run.node for run in runs]]

    def spend(seconds: NDArray[np.float64], climb: float) -> None:
        wind = air.aloft(place, now - setting.begin_s, now + setting.shift_s)
        speed = np.maximum(np.hypot(wind[:, 0], wind[:, 1]), HOVER_AIRSPEED_MPS)
        soc[:] -= share * setting.power(speed, climb) * seconds
        now[:] += seconds

    flying = np.zeros(len(runs))
    flying[list(going)] = 1.0
    spend(how.climb_s * flying, how.climb_mps)
    while any(not one.ends for one in outs.values()):
        end, middle = place.copy(), place.copy()
        for n, one in outs.items():
            if not one.ends:
                end[n], middle[n] = _next(setting, one, place[n])
        part = cruise(
            air, gusts, setting.power, how, (place, end), now - setting.begin_s, now + setting.shift_s, middle
        )
        now += part.took_s
        soc -= share * part.energy_j
        for n, one in outs.items():
            if not one.ends:
                wind = float(part.wind[n, 0]), float(part.wind[n, 1])
                _arrived(
                    setting,
                    policy,
                    one,
                    (place[n], end[n]),
                    (float(now[n]), float(part.took_s[n]), float(soc[n])),
                    wind,
                )
        place = end
    spend(how.descent_s * flying, -how.descent_mps)
    came = now.copy()
    hovered = np.zeros(len(runs))
    for n, one in outs.items():
        hovered[n] = (
            setting.stations[n].line(one.node).place_time(float(came[n])) - came[n] if one.node != HERE else 0.0
        )
    spend(hovered, 0.0)
    for n, one in outs.items():
        _landed(setting, one, (float(came[n]), float(now[n]), float(soc[n])))


def _next(setting: Setting, out: _Out, place: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the next piece ends, and the middle of the straight flight that it is of."""
    tail, head = _ends(setting, out, place)
    left_m = float(np.linalg.norm(head - place))
    # No piece is shorter than half of the others.
    next_m = min(LOOK_M, max(out.speed_mps * LOOK_S, LEAST_M))
    end = head if left_m <= 1.5 * next_m else place + (head - place) * (next_m / left_m)
    return end, 0.5 * (tail + head)


def _ends(setting: Setting, out: _Out, place: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ends of the straight flight under way: of its segment, or from where it was turned; it lands `HERE` at its place."""
    ground = setting.ground
    if out.turned is None:
        segment = out.way[len(out.flown)]
        return ground.xy[ground.tail[segment]], ground.xy[ground.head[segment]]
    begin = place if out.turned_at is None else out.turned_at
    return begin, ground.xy[out.turned] if out.turned != HERE else place


def _arrived(
    setting: Setting,
    policy: Policy,
    out: _Out,
    piece: tuple[NDArray[np.float64], NDArray[np.float64]],
    at: tuple[float, float, float],
    wind: tuple[float, float],
) -> None:
    """Note a piece that was flown from where to where, and ask what now; `at` is the time, how long the piece took, and the charge."""
    ground, run, (begin, end), (now, took, soc) = setting.ground, out.run, piece, at
    tail, head = _ends(setting, out, end)
    if took > 0.0:
        out.pieces.append(Piece(now - 0.5 * took, ground.plane.lat_lon(0.5 * (begin + end)), wind))
        out.speed_mps = float(np.linalg.norm(end - begin)) / took
    there = np.array_equal(end, head)
    if out.turned is not None:
        if there:
            out.node, out.turned, out.way = out.turned, None, out.flown
            return
    elif there:
        segment = out.way[len(out.flown)]
        out.node, out.flown, out.gone = int(ground.head[segment]), (*out.flown, segment), 0.0
        rest = out.way[len(out.flown) :]
        if rest and ground.pads[out.node] > 0:
            rest = policy.over(seen(setting, run, out.node, now, now, soc), rest)
            out.way = (*out.flown, *rest)
        if not rest:
            return
    else:
        out.gone = float(np.linalg.norm(end - tail)) / float(np.linalg.norm(head - tail))
    if not policy.watches:
        return
    told = setting.batteries.told_one
    turned = policy.aloft(
        Aloft(
            run.number, now, float(told(run.number, soc)), reports(setting, run.number, now),
            lines(setting, run.number, HERE, now, now), tuple(run.flights), run.node, out.off_s,
            float(told(run.number, run.soc)), out.way, out.way[len(out.flown)], out.gone, out.turned,
            ground.plane.lat_lon(end), tuple(out.pieces),
        )
    )  # fmt: skip
    if turned is not None and turned != out.turned:
        out.turned, out.turned_at = turned, end


def _landed(setting: Setting, out: _Out, at: tuple[float, float, float]) -> None:
    """Write a flight down; `at` is when it came, when it had a place, and the charge then."""
    run, (came, now, soc) = out.run, at
    told = setting.batteries.told_one
    wind = np.mean([one.wind for one in out.pieces], axis=0).tolist() if out.pieces else [0.0, 0.0]
    run.flights.append(
        Flown(
            run.node, out.node, out.flown, out.off_s, now, float(told(run.number, run.soc)), float(told(run.number, soc)),
            now - came, (wind[0], wind[1]),
        )
    )  # fmt: skip
    after = soc if out.node != HERE else min(soc, NOWHERE)
    run.node, run.time_s, run.came_s, run.soc = out.node, now, came, after
    run.landings.append(after)
