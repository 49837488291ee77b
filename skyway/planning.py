"""Planning from typed values, on a command line or on a page: they become a request, a wind and a plan."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path  # noqa: TC003  options read these annotations at run time
from typing import TYPE_CHECKING, cast
from zoneinfo import ZoneInfo

from skyway import typed_values
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import duration
from skyway.models.composition.release import Release  # noqa: TC001  options read these annotations at run time
from skyway.planner.registry import CLAIRVOYANT_PLANNERS, ROBUST
from skyway.scenarios import load_scenario, with_terrain

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.models.composition.composition import Recharge as RechargeMode
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.now import KnownPads, KnownWind
    from skyway.planner.departure import Departure
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.problem.request import Request
    from skyway.planner.result import PlanResult

SOON_S = 6 * 3600.0
"""A departure within so long is told that it is not now."""


@dataclass(frozen=True, kw_only=True)
class Delivery:
    """The package, its places, and its drone; percent and places as typed."""

    start: str
    to: str
    payload: float
    drone: str | None = None
    reserve: float = 20.0
    soc: float = 100.0
    airspeed: float | None = None
    recharge: str = "enough"
    seed: int = 0
    stop_at: list[str] | None = None
    not_before: str | None = None
    return_to: str = "nearest-pad"
    dwell: str | None = None
    if_undelivered: str | None = None
    release: Release = "gripper"

    def request(self, scenario: Scenario, depart: datetime, objective: str = "mean") -> tuple[Scenario, Request]:
        """Return what is asked, and the scenario: targets given as lat,lon join its network."""
        from skyway.models.composition.composition import State
        from skyway.planner.problem.request import BACK, HOME, NEAREST_PAD, NO_RETURN, Request

        scenario, origin = typed_values.place(scenario, self.start, "--from")
        scenario, destination = typed_values.place(scenario, self.to, "--to")
        state = State(depart, origin, None, typed_values.percent(self.soc, "--soc"))
        with typed_values.as_typed(objective=objective, not_before=self.not_before, dwell_s=self.dwell):
            return scenario, Request(
                state=state,
                destination=destination,
                payload_kg=self.payload,
                drone=self.drone,
                airspeed_mps=self.airspeed,
                reserve_soc=typed_values.percent(self.reserve, "--reserve", high=95.0),
                recharge=cast("RechargeMode", self.recharge),
                seed=self.seed,
                objective=typed_values.parse_objective(objective),
                not_before=None
                if self.not_before is None
                else typed_values.parse_time(self.not_before, "--not-before"),
                stop_at=tuple(_station(scenario, one, "--stop-at") for one in self.stop_at or ()),
                return_to=_goal(scenario, self.return_to, (HOME, NEAREST_PAD, NO_RETURN), "--return"),
                dwell_s=0.0 if self.dwell is None else typed_values.parse_duration(self.dwell, "--dwell"),
                undelivered_to=None
                if self.if_undelivered is None
                else _goal(scenario, self.if_undelivered, (BACK,), "--if-undelivered"),
                release=self.release,
            )


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """Where and when it is flown, and in which wind; all as typed."""

    scenario: Path | None = None
    depart: str | None = None
    wind: str | None = None
    forecast: list[Path] | None = None
    forecast_error: Path | None = None
    truth: str | None = None
    observed: list[str] | None = None
    terrain: list[str] | None = None
    obstacles: list[str] | None = None
    zones: list[Path] | None = None
    authorized: list[str] | None = None
    avoid: list[str] | None = None

    def loaded(self) -> Scenario:
        """Return the scenario, over the terrain, with the zones and the authorizations that are named."""
        with typed_values.as_typed():
            region = with_terrain(load_scenario(self.scenario), self.terrain, self.obstacles)
            return avoiding(region.with_airspace(self.zones or (), self.authorized or ()), self.avoid or ())

    @property
    def instant(self) -> datetime:
        """Departure; without one, now."""
        return typed_values.parse_depart(self.depart)

    def _unused(self, scenario: Scenario) -> tuple[str, ...]:
        """Say that the scenario's own observations do not count, for a departure that is not now but today."""
        ahead_s = (self.instant - datetime.now(UTC)).total_seconds()
        own = scenario.observed_wind or scenario.observed_pads is not None
        if not own or self.for_now or self.observed or not 0.0 < ahead_s < SOON_S:
            return ()
        return (f"the scenario's own observations are not used: the departure is {duration(ahead_s)} from now",)

    @property
    def for_now(self) -> bool:
        """Whether the departure is at this moment, give or take some minutes: then the scenario's own observations count, unasked."""
        from skyway.now import NOW_S

        return abs((self.instant - datetime.now(UTC)).total_seconds()) <= NOW_S

    def winds(self, scenario: Scenario, depart: datetime, truth: str | None) -> tuple[KnownWind, WindEnsemble | None]:
        """Return the wind that is forecast, given what was observed, and the wind that will blow, where that is given."""
        from skyway.now import HOW, KnownWind, condition_forecast, observed_winds
        from skyway.planner.problem.problem import HORIZON_H

        true, day = typed_values.true_wind(scenario, depart, truth)
        if self.wind is not None and self.observed:
            remedy = "remove one of them: a constant wind needs no observations"
            raise InputError("--wind and --observed exclude each other", remedy=remedy)
        if self.forecast_error is not None and not self.forecast:
            remedy = "give the forecast, too; for a scenario's own: [forecast] error"
            raise InputError("goes with --forecast", field="--forecast-error", remedy=remedy)
        by_record = self.wind is None and not self.forecast
        analogue = by_record and not scenario.has_forecast and (scenario.history is not None or true is None)
        of_scenario = self.for_now and by_record and not self.observed
        given = scenario.observed_wind if of_scenario else tuple(self.observed or ())

        def forecast(begin: datetime, hours: int) -> WindEnsemble:
            if analogue:
                return scenario.forecast(begin, hours, truth=day)
            if begin < depart and self.forecast:
                try:  # observations before the departure are compared with the wind of their hour, where the forecast has it
                    return scenario.forecast_from(self.forecast, begin, hours, error=self.forecast_error, truth=day)
                except InputError:
                    pass
            return typed_values.wind_forecast(
                scenario, depart, self.wind, self.forecast, true, day, self.forecast_error
            )

        if not given:
            alone = of_scenario and true is None and not scenario.has_forecast
            return KnownWind(forecast(depart, HORIZON_H), (), (HOW,) if alone else self._unused(scenario)), true
        found = observed_winds(scenario, given, min(self.instant, depart), missing_ok=of_scenario)
        known = condition_forecast(scenario, forecast, found, depart, analogue=analogue, must_count=not of_scenario)
        return known, true


@dataclass(frozen=True, kw_only=True)
class Pads:
    """Which pads are busy, as typed."""

    pads: str | None = None

    def known(self, scenario: Scenario, depart: datetime, *, for_now: bool) -> KnownPads | None:
        """Return the known state of the pads; None where none was given."""
        from skyway.now import pads_now

        if self.pads is not None:
            return pads_now(scenario, self.pads, depart)
        if for_now and scenario.observed_pads is not None:
            return pads_now(scenario, scenario.observed_pads, depart, asked=False)
        return None


def _station(scenario: Scenario, text: str, option: str) -> str:
    """Return the id of a station by id or part of its name."""
    with typed_values.named(option):
        return scenario.network.stations[scenario.network.find(text)].id


def _goal(scenario: Scenario, text: str, words: tuple[str, ...], option: str) -> str:
    """Return one of some words as typed, or the id of a station."""
    return text.strip().lower() if text.strip().lower() in words else _station(scenario, text, option)


def avoiding(scenario: Scenario, names: Sequence[str]) -> Scenario:
    """Return a scenario without some stations to land at, and without some segments, as typed: ``STATION`` or ``FROM:TO``.

    A station that is avoided keeps its place: it may still be flown over. A segment is avoided both ways.
    """
    import numpy as np

    network = scenario.network
    if not names:
        return scenario
    shut: set[str] = set()
    kept = np.ones(len(network.tail), dtype=bool)
    for name in names:
        begin, colon, end = name.partition(":")
        one = network.index[_station(scenario, begin, "--avoid")]
        if not colon:
            shut.add(network.stations[one].id)
            continue
        other = network.index[_station(scenario, end, "--avoid")]
        hit = ((network.tail == one) & (network.head == other)) | ((network.tail == other) & (network.head == one))
        if not hit.any():
            raise InputError(
                "no such segment",
                field="--avoid",
                value=name,
                remedy="FROM:TO, two stations with a segment between them",
            )
        kept &= ~hit
    stations = tuple(replace(one, pads=0) if one.id in shut else one for one in network.stations)
    number = np.cumsum(kept) - 1
    restricted = network.restricted[kept[network.restricted[:, 0]]].copy()
    restricted[:, 0] = number[restricted[:, 0]]
    left = replace(
        network, stations=stations, tail=network.tail[kept], head=network.head[kept], distance_m=network.distance_m[kept],
        bearing_deg=network.bearing_deg[kept], restricted=restricted,
    )  # fmt: skip
    return replace(scenario, network=left)


def with_pads(
    asked: tuple[Scenario, Request], conditions: Conditions, pads: Pads
) -> tuple[tuple[Scenario, Request], KnownPads | None]:
    """Return the request, with the known state of the pads now."""
    scenario, request = asked
    busy = pads.known(scenario, request.state.time, for_now=conditions.for_now)
    if busy is not None:
        request = replace(request, state=busy.seen_from(request.state))
    return (scenario, request), busy


def solve(
    scenario: Scenario,
    request: Request,
    conditions: Conditions,
    planner: str = ROBUST,
    *,
    time_limit_s: float,
    parameters: PlannerParameters,
    busy: KnownPads | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> PlanResult:
    """Plan with the chosen wind; `progress` is called with sequences evaluated and the best time, see `planner.plan.plan`."""
    from skyway.now import with_conditions
    from skyway.planner.plan import plan

    asked = _asked_for(request, conditions)
    if not time_limit_s > 0:
        raise InputError("must be above 0", field="--time-limit", value=time_limit_s)
    truth, clairvoyant = conditions.truth, planner in CLAIRVOYANT_PLANNERS
    if truth is None and clairvoyant and conditions.wind is None and conditions.forecast is None:
        truth = _own_day(scenario, request)
    with typed_values.as_typed():
        known, true = conditions.winds(scenario, request.state.time, truth)
        result = plan(
            scenario, request, planner=planner, forecast=known.forecast, truth=true, time_limit_s=time_limit_s,
            progress=progress, parameters=parameters,
        )  # fmt: skip
    seen, notes = ((), ()) if busy is None else (busy.conditions, busy.notes)
    notes = (*notes, *asked)
    if conditions.truth is not None and not clairvoyant:
        told = ", ".join(CLAIRVOYANT_PLANNERS)
        notes += (f"{planner} is not told the actual wind, only planners with perfect information are ({told})",)
    if clairvoyant:  # it is told the wind
        return with_conditions(result, seen, notes)
    return with_conditions(result, (*known.conditions, *seen), (*known.notes, *notes))


def solve_window(
    scenario: Scenario,
    request: Request,
    conditions: Conditions,
    window: str,
    planner: str = ROBUST,
    *,
    parameters: PlannerParameters,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[PlanResult, list[Departure]]:
    """Plan for the best departure of a window, and return the departures tried; `progress` is called with how many of how many."""
    from skyway.now import with_conditions
    from skyway.planner.departure import plan_within

    if planner in CLAIRVOYANT_PLANNERS or conditions.truth is not None:
        problem = "cannot be combined with planners that have perfect information"
        remedy = "robust or one of the pfs planners, without --actual-wind"
        raise InputError(problem, field="--depart-window", remedy=remedy)
    asked = _asked_for(request, conditions)
    length_s = typed_values.parse_duration(window, "--depart-window")
    winds: dict[datetime, KnownWind] = {}

    def known(depart: datetime) -> WindEnsemble:
        winds[depart] = conditions.winds(scenario, depart, None)[0]
        return winds[depart].forecast

    with typed_values.as_typed():
        result, tried = plan_within(
            scenario, request, length_s, planner=planner, forecast=known, progress=progress, parameters=parameters
        )
    wind = winds[result.problem.request.state.time]
    return with_conditions(result, wind.conditions, (*wind.notes, *asked)), tried


def _asked_for(request: Request, conditions: Conditions) -> list[str]:
    """Say what was asked of the route: in flight it is planned again without it.

    Raises an `InputError` if start, destination or a stop that is requested is to be avoided.
    """
    both = {request.state.station, request.destination, *request.stop_at} & set(conditions.avoid or ())
    if both:
        remedy = "remove it from one of them"
        raise InputError(
            "is the start, the destination or a requested stop",
            field="--avoid",
            value=", ".join(sorted(map(str, both))),
            remedy=remedy,
        )
    ways = [("stops", request.stop_at), ("avoided", conditions.avoid or ())]
    said = [f"{words} as requested: {', '.join(names)}" for words, names in ways if names]
    return [f"{'; '.join(said)}; replanning in flight does not know it"] if said else []


def _own_day(scenario: Scenario, request: Request) -> str | None:
    """Local date of the departure, where the record holds its wind: then that is the truth."""
    from skyway.planner.problem.problem import HORIZON_H

    day = request.state.time.astimezone(ZoneInfo(scenario.timezone)).date()
    try:
        scenario.truth(day, request.state.time, HORIZON_H)
    except InputError:
        return None
    return day.isoformat()
