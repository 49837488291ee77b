"""Current weather and pads: reads observations, and conditions a plan on them.

>>> import skyway
>>> from skyway.now import condition_forecast, observed_winds
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace as replace_fields

from skyway.models.base.errors import InputError, LinkError
from skyway.models.base.formatting import duration
from skyway.models.base.units import from_posix
from skyway.models.base.views import counted as counted_of
from skyway.models.composition.conditions import Condition
from skyway.models.wind.estimation.field import ResidualModel, WindObservation
from skyway.models.wind.observed.conditioning import conditioned, counted, nothing_counts
from skyway.models.wind.observed.reading import Observations, ObservedWind, read_observed
from skyway.models.wind.triangle import speed_from
from skyway.planner.parameters.planner import USUAL
from skyway.planner.problem.problem import HORIZON_H

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from datetime import datetime

    from skyway.models.composition.composition import State
    from skyway.models.queues.seen_pads import SeenPads
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.result import PlanResult

NOW_S = 600.0
"""A departure within so much from this moment is now."""
PADS_OLDEST_S = 1800.0
"""Who is on the pads is taken as at the departure: by then a third of those who charge for an hour have left."""
OUT_OF_ORDER_S = 24 * 3600.0
"""A pad that the scenario has and its service has not is taken to be out of order for so long."""
NAMED = 5
"""Places that a note names."""
HOW = (
    "planned from the record alone, without current weather: give it with --observed SITE=SPEED@FROM or a file of METARs, and "
    "busy pads with --pads; or name the files under [observed] in scenario.toml"
)


@dataclass(frozen=True)
class KnownWind:
    """A forecast, and the observations that condition it."""

    forecast: WindEnsemble
    conditions: tuple[Condition, ...] = ()
    notes: tuple[str, ...] = ()


def observed_winds(
    scenario: Scenario, given: Sequence[str], depart: datetime, *, missing_ok: bool = False
) -> Observations:
    """Read observed winds: typed, files, and journals of ``skyway fly`` (``.jsonl``).

    An `InputError` has what is wrong. With `missing_ok` a file that is not there is a note.
    """
    if given and not scenario.wind_sites:
        remedy = "name them in [[wind.sites]]"
        raise InputError("the scenario has no wind sites", scenario.path, field="--observed", remedy=remedy)
    found = Observations()
    for one in given:
        if missing_ok and not os.path.exists(one):  # noqa: PTH110  it takes any text
            found += Observations((), (f"no current wind: {one} does not exist",))
            continue
        if Path(one).suffix == ".jsonl":
            told = Observations(_of_journal(Path(one), scenario))
        else:
            told = read_observed(one, scenario.wind_sites, scenario.measured_at_m, depart.timestamp())
        found += told if told.winds or told.notes else Observations((), (f"{one} has no wind",))
    return found


def _of_journal(path: Path, scenario: Scenario) -> tuple[ObservedWind, ...]:
    """The winds that a drone had measured when a journal was last written."""
    from skyway.link.supervisor import read_journal
    from skyway.link.supervisor.journal.standing import measured_winds

    height_m = scenario.rules.cruise_height_m
    found = []
    for one in measured_winds(read_journal(path).records):
        numbers = one.time_s, one.lat_deg, one.lon_deg, one.north_mps, one.east_mps, one.variance
        if any(number is None for number in numbers):
            continue
        seen = WindObservation(*numbers, height_m)  # type: ignore[arg-type]
        speed, degrees = map(float, speed_from(seen.north_mps, seen.east_mps))
        place = f"{seen.lat_deg:.3f},{seen.lon_deg:.3f}"
        found.append(ObservedWind(place, str(path), speed, degrees, seen, drone=True))
    return tuple(found)


def condition_forecast(
    scenario: Scenario,
    forecast: Callable[[datetime, int], WindEnsemble],
    observed: Observations,
    depart: datetime,
    *,
    analogue: bool = True,
    must_count: bool = True,
    parameters: PlannerParameters = USUAL,
) -> KnownWind:
    """Condition a forecast on what was observed before a departure.

    `forecast` gives it from an instant on, for so many hours; `analogue` tells whether it consists of days of the record. Where nothing that was handed over counts, an `InputError` says why, or,
    without `must_count`, the notes do.
    """
    chosen = counted(observed.winds, scenario.wind_sites, depart.timestamp())
    notes = observed.notes + chosen.notes
    if not chosen.winds:
        if must_count and (observed.winds or observed.notes):
            raise nothing_counts(observed.winds, notes, depart)
        return KnownWind(forecast(depart, HORIZON_H), (), notes)
    if any(one.observation.time_s > time.time() + NOW_S for one in chosen.winds):
        notes += ("the observed wind is of a time still to come: the promise holds if the wind is so then",)
    found, doubts = conditioned(
        forecast, chosen.winds, depart, HORIZON_H, exponent=scenario.rules.wind_profile_exponent,
        residual=ResidualModel(tau_s=parameters.online.residual_tau_s), members=parameters.robust.members, analogue=analogue,
    )  # fmt: skip
    return KnownWind(found, tuple(_wind_condition(one, depart) for one in chosen.winds), (*notes, *doubts))


class LiveWinds:
    """Winds observed, for a flight that conditions its forecast itself: files are read again whenever they have changed.

    A file that cannot be read then is told once, and what was read before counts on. Where nothing that was handed over counts at the
    start, an `InputError` says why; where nobody asked (`asked`), a note does.
    """

    def __init__(
        self, scenario: Scenario, given: Sequence[str], now: datetime, *, asked: bool, tell: Callable[[str], None]
    ) -> None:
        self._scenario, self._given, self._tell = scenario, tuple(given), tell
        self._stamps = self._changed()
        self._found = observed_winds(scenario, given, now, missing_ok=not asked)
        chosen = counted(self._found.winds, scenario.wind_sites, now.timestamp())
        notes = self._found.notes + chosen.notes
        if asked and given and not chosen.winds:
            raise nothing_counts(self._found.winds, notes, now)
        for note in notes:
            tell(note)

    def __call__(self, time_s: float) -> tuple[WindObservation, ...]:
        """What counts at an instant, POSIX seconds."""
        stamps = self._changed()
        if stamps != self._stamps:
            self._stamps = stamps
            try:
                self._found = observed_winds(self._scenario, self._given, from_posix(time_s))
            except InputError as error:
                self._tell(f"{error}; still using the winds read before")
        try:
            chosen = counted(self._found.winds, self._scenario.wind_sites, time_s)
        except InputError as error:
            self._tell(f"{error}; none of these winds is usable")
            self._found = replace(self._found, winds=())
            return ()
        return tuple(one.observation for one in chosen.winds)

    def _changed(self) -> tuple[tuple[int, int], ...]:
        """Time of the last change and size of each file."""
        found = []
        for one in self._given:
            try:
                told = Path(one).stat()
            except (OSError, ValueError):
                found.append((0, 0))
            else:
                found.append((told.st_mtime_ns, told.st_size))
        return tuple(found)


def _wind_condition(one: ObservedWind, depart: datetime) -> Condition:
    time = from_posix(one.observation.time_s)
    age_s = max((depart - time).total_seconds(), 0.0)
    return Condition("wind", one.place, time, age_s, one.source, one.speed_mps, one.from_deg)


@dataclass(frozen=True)
class KnownPads:
    """Pads seen before a departure, with notes for people."""

    busy: dict[str, int]
    free_s: dict[str, tuple[float, ...]]
    conditions: tuple[Condition, ...] = ()
    notes: tuple[str, ...] = ()

    def seen_from(self, state: State) -> State:
        """Return a state that knows of them."""
        return replace(
            state, busy_pads={**state.busy_pads, **self.busy}, pads_free_s={**state.pads_free_s, **self.free_s}
        )


def pads_now(scenario: Scenario, given: str, depart: datetime, *, asked: bool = True) -> KnownPads:
    """Read which pads are busy: from a pad service at ``tcp:HOST:PORT``, asked once, or from a file of its answers.

    What was seen longer than half an hour before the departure, or after it, is omitted. An `InputError` or `LinkError` says what is
    wrong; where nobody asked for them (`asked`), a service that fails and a file that is not there are notes.
    """
    seen, notes = _seen_pads(scenario, given, asked=asked)
    depart_s = depart.timestamp()
    ages = {one.station: depart_s - (depart_s if one.posix_s is None else one.posix_s) for one in seen}
    counts = [one for one in seen if -NOW_S <= ages[one.station] <= PADS_OLDEST_S]
    left_out = [one for one in seen if one not in counts]
    if left_out:
        age = max((ages[one.station] for one in left_out), key=abs)
        when = f"{duration(abs(age))} {'before' if age > 0.0 else 'after'} the departure"
        notes.append(
            f"pads of {counted_of(len(left_out), 'station')} are ignored: seen {when}, the limit is {duration(PADS_OLDEST_S)} before it"
        )
    if asked and not counts:
        remedy = "give pads seen shortly before the departure, or omit the option"
        raise InputError(f"no usable pad reports: {'; '.join(notes)}", field="--pads", value=given, remedy=remedy)
    busy, free_s = {}, {}
    fewer: list[str] = []
    for one in counts:
        has = scenario.network.stations[scenario.network.index[one.station]].pads
        gone = 0 if one.pads is None else max(has - one.pads, 0)
        seen_s = depart_s - ages[one.station]
        ends = [seen_s + wait for wait in one.remaining_s] + gone * [depart_s + OUT_OF_ORDER_S]
        busy[one.station] = one.present + gone
        if ends:
            free_s[one.station] = tuple(ends)
        if gone:
            fewer.append(f"{one.station} {one.pads} of {has}")
    if fewer:
        more = f", and {len(fewer) - NAMED} more" if len(fewer) > NAMED else ""
        hours = duration(OUT_OF_ORDER_S)
        notes.append(f"fewer pads than the scenario has, for {hours} at least: {', '.join(fewer[:NAMED])}{more}")
    conditions = tuple(
        Condition(
            "pads",
            one.station,
            from_posix(depart_s - ages[one.station]),
            max(ages[one.station], 0.0),
            given,
            busy=one.present,
        )
        for one in counts
    )
    return KnownPads(busy, free_s, conditions, tuple(notes))


def _seen_pads(scenario: Scenario, given: str, *, asked: bool) -> tuple[list[SeenPads], list[str]]:
    from skyway.link.pads import snapshot
    from skyway.models.queues.seen_pads import SeenPads, read_seen_pads

    network = scenario.network
    if not given.startswith("tcp:"):
        if not asked and not os.path.exists(given):  # noqa: PTH110
            return [], [f"no current pads: {given} does not exist"]
        of_file = read_seen_pads(Path(given), network.index)
        # A scenario's own file is rewritten by a job: without times in it, it is as old as the file.
        written_s = None if asked else Path(given).stat().st_mtime
        return [replace_fields(one, posix_s=written_s) if one.posix_s is None else one for one in of_file], []
    try:
        found, notes = snapshot(given, [one.id for one in network.stations if one.pads])
    except LinkError as error:
        where = "" if given in str(error) else f"{given}: "
        if asked and where:
            raise LinkError(f"{where}{error}") from error
        if asked:
            raise
        return [], [f"no current pads: {where}{error}"]
    pads = [
        SeenPads(station=one.station, busy=one.busy, pads=one.pads, waiting=one.waiting, remaining_s=one.remaining_s, posix_s=one.posix_s)
        for one in found if one.station in network.index
    ]  # fmt: skip
    return pads, notes


def with_conditions(result: PlanResult, conditions: Sequence[Condition], notes: Sequence[str]) -> PlanResult:
    """Return a plan that names its conditions."""
    if not conditions and not notes:
        return result
    plan = result.composition
    told = told_conditions(conditions)
    plan = replace(plan, conditions=(*plan.conditions, *conditions), notes=(*plan.notes, *told, *notes))
    return replace(result, composition=plan)


def told_conditions(conditions: Sequence[Condition]) -> list[str]:
    """Describe the conditions of a plan or a forecast."""
    return [
        *_told_winds([one for one in conditions if one.kind == "wind"]),
        *_told_pads([one for one in conditions if one.kind == "pads"]),
    ]


def _told_winds(winds: Sequence[Condition]) -> list[str]:
    from skyway.models.base.formatting import speed_text, wind_text

    if not winds:
        return []
    words = [
        f"{one.place} {speed_text(one.speed_mps) if one.from_deg is None else wind_text(one.speed_mps or 0.0, one.from_deg)}, "
        + (f"{duration(one.age_s)} before the departure" if one.age_s >= 60.0 else "at the departure")
        for one in winds[:NAMED]
    ]
    more = f"; and {len(winds) - NAMED} more" if len(winds) > NAMED else ""
    return [f"conditioned on the observed wind: {'; '.join(words)}{more}"]


def _told_pads(pads: Sequence[Condition]) -> list[str]:
    if not pads:
        return []
    most = sorted(pads, key=lambda one: -(one.busy or 0))[:NAMED]
    words = ", ".join(f"{counted_of(one.busy or 0, 'drone')} at {one.place}" for one in most)
    oldest_s = max(one.age_s for one in pads)
    when = f"up to {duration(oldest_s)} before the departure" if oldest_s >= 60.0 else "at the departure"
    more = f", and {counted_of(len(pads) - NAMED, 'other station')}" if len(pads) > NAMED else ""
    return [f"conditioned on the pads seen {when}: {words}{more}"]
