"""What an online decision is made with, and what it says."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from skyway.models.composition.composition import Composition
    from skyway.models.drones.energy_belief import EnergyBelief
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.online.reach import Place
    from skyway.planner.online.turn_back_kernels import TurnBack

Action = Literal["continue", "speed", "charge", "wait", "station", "divert", "land", "stop"]


@dataclass(slots=True)
class FlightMemory:
    """What was decided in a flight so far; one for each flight, changed by the decisions.

    Attributes
    ----------
    turned : bool
        It was turned elsewhere: only an empty battery turns it again.
    doubtful : int
        Looks in a row that found the landing in danger.
    speed_s, better_s : float
        When the ground speed was sent, and a better station looked for, last.
    weighed : (float, float)
        When the alternatives were weighed last, and the risk then.
    airspeed_mps : float or None
        Chosen instead of the planned one.
    over : str
        Station on the way that was decided about.
    """

    turned: bool = False
    doubtful: int = 0
    speed_s: float = -math.inf
    better_s: float = -math.inf
    weighed: tuple[float, float] = (-math.inf, 0.0)
    airspeed_mps: float | None = None
    over: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Information:
    """What is known when a decision is due: the information state of a delivery under way.

    Attributes
    ----------
    time_s, soc : float
        Now, POSIX seconds, and the state of charge.
    forecast : WindEnsemble
        Brought up to date with what was measured, in slots that plans are made with.
    near_forecast : WindEnsemble or None
        The same in finer slots, for what is begun now: what was measured fades within an hour.
    belief : EnergyBelief
        How much energy flights take; in the air, this one so far counted in.
    measured : bool
        The wind of each hour is measured at the sites: who waits for the next one knows more. Else only flights measure it.
    watched : bool
        Decisions follow all along the flight, and divert stations are at hand: a leg need not be sure in all but a quarter of the request's
        epsilon when it begins, as where nothing is decided in the air.
    station : str or None
        Where it stands. In the air: the station that it is over, time and charge set back by a climb, as if it took off there.
    visited : frozenset of str
        Stations landed at before.
    busy_pads : mapping of str to int
        Others on the pads and in line at stations, as the pad services tell; where it stands, those before it.
    behind : int
        Others that came after it to where it stands.
    unusable : frozenset of str
        Stations that must not be flown to now.
    plan : Composition or None
        Plan in force from where it stands: its next leg is left only for a clear gain.
    planned_soc : float or None
        Charge that the plan leaves with; None where it does not charge here.
    here : (lat, lon) or None
        Where it flies, at cruise height; None on the ground and exactly over a station.
    via, destination : tuple of str, str
        Of the leg flown: stations still to be overflown, and where it lands.
    commanded_mps : float
        Ground speed it was last told.
    diverts : tuple of str
        Stations that it may go to instead: inside its fence.
    left : frozenset of str
        Stations that it has stood at and left: gone back to for the reserve alone, never because that seems better.
    sudden : bool
        Charge was lost at once: there is no time to look twice.
    cleared_m : float
        Ground above sea level that it clears by the cruise height, as high as it flies; minus infinity on the ground.
    airspeed_limit_mps : float
        It is seen not to fly faster through the air than this, though it is told to.
    flight : FlightMemory
        What was decided in this flight before.
    """

    time_s: float
    soc: float
    forecast: WindEnsemble
    belief: EnergyBelief
    near_forecast: WindEnsemble | None = None
    measured: bool = False
    watched: bool = True
    station: str | None = None
    visited: frozenset[str] = frozenset()
    busy_pads: Mapping[str, int] = field(default_factory=dict)
    behind: int = 0
    unusable: frozenset[str] = frozenset()
    plan: Composition | None = None
    planned_soc: float | None = None
    here: Place | None = None
    via: tuple[str, ...] = ()
    destination: str = ""
    commanded_mps: float = math.nan
    diverts: tuple[str, ...] = ()
    left: frozenset[str] = frozenset()
    sudden: bool = False
    cleared_m: float = -math.inf
    airspeed_limit_mps: float = math.inf
    flight: FlightMemory = field(default_factory=FlightMemory)


@dataclass(frozen=True, slots=True)
class Departure:
    """How to leave a stop, until the wind is measured again or it is time to look again.

    Attributes
    ----------
    segments : tuple of int
        Flown without a landing between, if all goes well; empty: stay.
    charge : float
        Take-off with at least this charge.
    required : callable
        Charge without which the flight is not begun at a time, POSIX seconds.
    look_s : float
        Decide again then, POSIX seconds.
    turn_back : TurnBack or None
        How it may turn back on the first segment.
    """

    segments: tuple[int, ...]
    charge: float
    required: Callable[[float], float]
    look_s: float = math.inf
    turn_back: TurnBack | None = None


@dataclass(frozen=True, slots=True)
class Decision:
    """What to do now.

    Attributes
    ----------
    action : str
        ``continue``; ``speed``: fly on at another ground speed; ``charge``: to another state of charge; ``wait``;
        ``station``: another next station; ``divert``: to a station, now; ``land``: here, now; ``stop``: stay on the ground.
    reason : str
        A sentence with figures.
    figures : mapping
        What it was decided by.
    composition : Composition or None
        The plan from here, on the ground.
    station : str or None
        Where to, for ``divert`` and ``station``.
    speed_mps : float or None
        For ``speed``.
    charge_to : float or None
        Charge to leave with, or to charge to while it waits; on the ground.
    diverts : tuple of str
        Divert stations of the next leg, on the ground.
    until_s : float or None
        For ``wait``: POSIX seconds at which to look again.
    departure : Departure or None
        How to leave, on the ground.
    segments : tuple of int
        Over a station: segments to go on with; none: land there.
    """

    action: Action
    reason: str
    figures: Mapping[str, Any] = field(default_factory=dict)
    composition: Composition | None = None
    station: str | None = None
    speed_mps: float | None = None
    charge_to: float | None = None
    diverts: tuple[str, ...] = ()
    until_s: float | None = None
    departure: Departure | None = None
    segments: tuple[int, ...] = ()
