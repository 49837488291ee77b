"""The information of an online decision, and its answer."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from skyway.models.composition.composition import Composition
    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.online.turn_back_kernels import TurnBack
    from skyway.planner.reach.reach import Place

Action = Literal["continue", "speed", "charge", "wait", "station", "divert", "land", "stop"]


@dataclass(slots=True)
class FlightMemory:
    """Decisions of a flight so far; one for each flight, updated by the decisions."""

    turned: bool = False
    """It was turned elsewhere: only an empty battery turns it again."""
    doubtful: int = 0
    """Looks in a row that found the landing in danger."""
    speed_s: float = -math.inf
    better_s: float = -math.inf
    """When the ground speed was sent, and a better station looked for, last."""
    weighed: tuple[float, float] = (-math.inf, 0.0)
    """When the alternatives were weighed last, and the risk then."""
    airspeed_mps: float | None = None
    """Chosen instead of the planned one."""
    over: str = ""
    """Station on the way that was decided about."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Information:
    """Information state of a delivery under way when a decision is due."""

    time_s: float
    soc: float
    """Now, POSIX seconds, and the state of charge."""
    forecast: WindEnsemble
    """Brought up to date with what was measured, in slots that plans are made with."""
    belief: EnergyBelief
    """How much energy flights take; in the air, this one so far counted in."""
    near_forecast: WindEnsemble | None = None
    """The same in finer slots, for what starts now: what was measured fades within an hour."""
    measured: bool = False
    """The wind of each hour is measured at the sites: who waits for the next one knows more. Else only flights measure
    it."""
    watched: bool = True
    """Decisions follow all along the flight, and divert stations are at hand: a leg need not be sure in all but a
    quarter of the request's epsilon when it begins, as where nothing is decided in the air."""
    measures_wind: bool = True
    """Whether the drone is known to measure the wind on its way: its drag is known, or its autopilot has reported the wind. Else a flight knows no
    more of the wind halfway than at its take-off."""
    station: str | None = None
    """Where it stands. In the air: the station that it is over, time and charge set back by a climb, as if it took off
    there."""
    visited: frozenset[str] = frozenset()
    """Stations landed at before."""
    roughness: float = 1.0
    """Variance of changes of the wind that it felt, as a multiple of the usual one (`models.wind.estimation.roughness`)."""
    wind_measured_s: float = math.nan
    """On the ground: when it measured the wind in flight last, POSIX seconds; NaN: it never did."""
    busy_pads: Mapping[str, int] = field(default_factory=dict)
    """Others on the pads and in line at stations, as the pad services tell; where it stands, those before it."""
    behind: int = 0
    """Others that came after it to where it stands."""
    plan: Composition | None = None
    """Plan in force from where it stands: its next leg is left only for a clear gain."""
    planned_soc: float | None = None
    """Charge that the plan leaves with; None where it does not charge here."""
    here: Place | None = None
    """Where it flies, at cruise height; None on the ground and exactly over a station."""
    via: tuple[str, ...] = ()
    destination: str = ""
    """Of the leg flown: stations still to be overflown, and where it lands."""
    commanded_mps: float = math.nan
    """Ground speed it was last told."""
    diverts: tuple[str, ...] = ()
    """Stations that it may go to instead: inside its fence."""
    left: frozenset[str] = frozenset()
    """Stations that it has stood at and left: gone back to for the reserve alone, never because that seems better."""
    sudden: bool = False
    """Charge was lost at once: there is no time to look twice."""
    cleared_m: float = -math.inf
    """Ground above sea level that it clears by the cruise height, as high as it flies; minus infinity on the ground."""
    airspeed_limit_mps: float = math.inf
    """It is seen not to fly faster through the air than this, though it is told to."""
    flight: FlightMemory = field(default_factory=FlightMemory)
    """What was decided in this flight before."""


@dataclass(frozen=True, slots=True)
class Departure:
    """How to leave a stop, until the wind is measured again or it is time to look again."""

    segments: tuple[int, ...]
    """Flown without a landing between, if all goes well; empty: stay."""
    charge: float
    """Take-off with at least this charge."""
    required: Callable[[float], float]
    """Charge without which the flight is not started at a time, POSIX seconds."""
    look_s: float = math.inf
    """Decide again then, POSIX seconds."""
    turn_back: TurnBack | None = None
    """How it may turn back on the first segment."""


@dataclass(frozen=True, slots=True)
class Decision:
    """What to do now."""

    action: Action
    """``continue``; ``speed``: fly on at another ground speed; ``charge``: to another state of charge; ``wait``;
    ``station``: another next station; ``divert``: to a station, now; ``land``: here, now; ``stop``: stay on the
    ground."""
    reason: str
    """A sentence with figures."""
    figures: Mapping[str, Any] = field(default_factory=dict)
    """What it was decided by."""
    composition: Composition | None = None
    """The plan from here, on the ground."""
    station: str | None = None
    """Where to, for ``divert`` and ``station``."""
    speed_mps: float | None = None
    """For ``speed``."""
    charge_to: float | None = None
    """Charge to leave with, or to charge to while it waits; on the ground."""
    diverts: tuple[str, ...] = ()
    """Divert stations of the next leg, on the ground."""
    until_s: float | None = None
    """For ``wait``: POSIX seconds at which to look again."""
    departure: Departure | None = None
    """How to leave, on the ground."""
    segments: tuple[int, ...] = ()
    """Over a station: segments to continue with; none: land there."""
    least_soc: float | None = None
    """Charge that is enough to leave with, where the plan has another; on the ground."""
