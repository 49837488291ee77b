"""Options of a delivery to be planned: what is carried where, and when and in which wind."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from skyway.cli import completion, options
from skyway.models.base.errors import InputError
from skyway.scenarios import load_scenario, with_terrain

if TYPE_CHECKING:
    from skyway.models.composition.composition import Recharge as RechargeMode
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.now import KnownPads, KnownWind
    from skyway.planner.problem.request import Request

Depart = Annotated[str | None, typer.Option(help="Departure with UTC offset, 2013-07-10T14:00-04:00. Without it: now.")]
OBSERVED_HELP = (
    "Wind observed before the departure: SITE=SPEED@FROM[@TIME] (m/s@degrees FROM, at the site's anemometer), or a file: METARs, a table, "
    "a journal of fly; repeatable."
)
FORECAST_HELP = "Weather forecast, of any form that skyway weather reads (GRIB, NetCDF, Open-Meteo, TAF, CSV), or a folder of them; repeatable."
ERROR_HELP = "Error of such forecasts by lead time, from skyway weather verify -o. Without it: published figures."
_PLACE = "station id, part of its name, or lat,lon."


@dataclass(frozen=True, slots=True, kw_only=True)
class RequestOptions:
    """What is carried, from where to where, and by what."""

    start: Annotated[str, typer.Option("--from", help=f"Start: {_PLACE}", autocompletion=completion.stations)]
    to: Annotated[str, typer.Option(help=f"Destination: {_PLACE}", autocompletion=completion.stations)]
    payload: Annotated[float, typer.Option(help="Mass of the package, kg.")]
    drone: Annotated[
        str | None, typer.Option(help="Drone id. Without it the planner chooses.", autocompletion=completion.drones)
    ] = None
    reserve: Annotated[float, typer.Option(help="Least charge at any landing, percent.")] = 20.0
    soc: Annotated[float, typer.Option(help="Charge at the start, percent.")] = 100.0
    airspeed: Annotated[float | None, typer.Option(help="Planned airspeed, m/s. Without it: the drone's.")] = None
    recharge: Annotated[
        str, typer.Option(help="At each stop charge to 100 % (full) or to what the next flight needs (enough).")
    ] = "enough"
    seed: Annotated[int, typer.Option(help="Random seed of all sampling.", min=0, max=2**32 - 1)] = 0

    def request(self, scenario: Scenario, depart: datetime, objective: str = "mean") -> tuple[Scenario, Request]:
        """Return what is asked, and the scenario: targets given as lat,lon join its network."""
        from skyway.models.composition.composition import State
        from skyway.planner.problem.request import Request

        scenario, origin = options.place(scenario, self.start, "--from")
        scenario, destination = options.place(scenario, self.to, "--to")
        state = State(depart, origin, None, options.percent(self.soc, "--soc"))
        with options.as_typed():
            return scenario, Request(
                state=state,
                destination=destination,
                payload_kg=self.payload,
                drone=self.drone,
                airspeed_mps=self.airspeed,
                reserve_soc=options.percent(self.reserve, "--reserve", high=95.0),
                recharge=cast("RechargeMode", self.recharge),
                seed=self.seed,
                objective=options.parse_objective(objective),
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionOptions:
    """Where and when it is flown, and in which wind."""

    scenario: options.ScenarioArgument = None
    depart: Depart = None
    wind: Annotated[str | None, typer.Option(help="One constant wind at cruise height, m/s@degrees FROM: 8@270.")] = (
        None
    )
    forecast: Annotated[list[Path] | None, typer.Option(help=FORECAST_HELP)] = None
    forecast_error: Annotated[Path | None, typer.Option(help=ERROR_HELP)] = None
    truth: Annotated[
        str | None,
        typer.Option(
            "--actual-wind",
            help="The wind that will really blow, for planners with perfect information: a day of the record (2013-07-10) or a forecast file with one member.",
        ),
    ] = None

    observed: Annotated[
        list[str] | None,
        typer.Option(help=OBSERVED_HELP),
    ] = None

    terrain: options.TerrainFiles = None
    obstacles: options.ObstacleFiles = None
    zones: options.Zones = None
    authorized: options.Authorized = None

    def loaded(self) -> Scenario:
        """Return the scenario, over the terrain, with the zones and the authorizations that are named."""
        with options.as_typed():
            region = with_terrain(load_scenario(self.scenario), self.terrain, self.obstacles)
            return region.with_airspace(self.zones or (), self.authorized or ())

    @property
    def instant(self) -> datetime:
        """Departure; without one, now."""
        return options.parse_depart(self.depart)

    @property
    def for_now(self) -> bool:
        """Whether the departure is at this moment, give or take some minutes: then the scenario's own observations count, unasked."""
        from skyway.now import NOW_S

        return abs((self.instant - datetime.now(UTC)).total_seconds()) <= NOW_S

    def winds(self, scenario: Scenario, depart: datetime, truth: str | None) -> tuple[KnownWind, WindEnsemble | None]:
        """Return the wind that is forecast, given what was observed, and the wind that will blow, where that is given."""
        from skyway.now import HOW, KnownWind, condition_forecast, observed_winds
        from skyway.planner.problem.problem import HORIZON_H

        true, day = options.true_wind(scenario, depart, truth)
        if self.wind is not None and self.observed:
            remedy = "leave one of them out: a constant wind knows of no other"
            raise InputError("--wind and --observed exclude each other", remedy=remedy)
        if self.forecast_error is not None and not self.forecast:
            remedy = "give the forecast, too; for a scenario's own: [forecast] error"
            raise InputError("goes with --forecast", field="--forecast-error", remedy=remedy)
        by_record = self.wind is None and not self.forecast
        of_scenario = self.for_now and by_record and not self.observed
        given = scenario.observed_wind if of_scenario else tuple(self.observed or ())

        def forecast(begin: datetime, hours: int) -> WindEnsemble:
            if by_record and not scenario.has_forecast and (scenario.history is not None or true is None):
                return scenario.forecast(begin, hours, truth=day)
            if begin < depart and self.forecast:
                try:  # observations before the departure are compared with the wind of their hour, where the forecast has it
                    return scenario.forecast_from(self.forecast, begin, hours, error=self.forecast_error, truth=day)
                except InputError:
                    pass
            return options.wind_forecast(scenario, depart, self.wind, self.forecast, true, day, self.forecast_error)

        if not given:
            alone = of_scenario and true is None and not scenario.has_forecast
            return KnownWind(forecast(depart, HORIZON_H), (), (HOW,) if alone else ()), true
        found = observed_winds(scenario, given, depart, missing_ok=of_scenario)
        return condition_forecast(scenario, forecast, found, depart, must_count=not of_scenario), true


@dataclass(frozen=True, slots=True, kw_only=True)
class PadOptions:
    """Which pads are busy."""

    pads: Annotated[
        str | None,
        typer.Option(help="Pads busy now: a pad service tcp:HOST:PORT, asked once, or a file of its answers."),
    ] = None

    def known(self, scenario: Scenario, depart: datetime, *, for_now: bool) -> KnownPads | None:
        """Return what is known of the pads; None where nothing was handed over."""
        from skyway.now import pads_now

        if self.pads is not None:
            return pads_now(scenario, self.pads, depart)
        if for_now and scenario.observed_pads is not None:
            return pads_now(scenario, scenario.observed_pads, depart, asked=False)
        return None
