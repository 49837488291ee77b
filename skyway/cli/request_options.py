"""Options of a delivery to be planned: what is carried where, and when and in which wind."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from skyway.cli import completion, options
from skyway.scenarios import load_scenario

if TYPE_CHECKING:
    from datetime import datetime

    from skyway.models.composition.composition import Recharge as RechargeMode
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.problem.request import Request

Depart = Annotated[str | None, typer.Option(help="Departure with UTC offset, 2013-07-10T14:00-04:00. Without it: now.")]
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
    forecast: Annotated[Path | None, typer.Option(help="Forecast file: time, site, member, speed_mps, from_deg.")] = (
        None
    )
    truth: Annotated[
        str | None,
        typer.Option(
            "--actual-wind",
            help="The wind that will really blow, for planners with perfect information: a day of the record (2013-07-10) or a forecast file with one member.",
        ),
    ] = None

    def loaded(self) -> Scenario:
        """Return the scenario."""
        return load_scenario(self.scenario)

    @property
    def instant(self) -> datetime:
        """Departure; without one, now."""
        return options.parse_depart(self.depart)

    def winds(
        self, scenario: Scenario, depart: datetime, truth: str | None
    ) -> tuple[WindEnsemble, WindEnsemble | None]:
        """Return the wind that is forecast, and the wind that will blow, where that is given."""
        true, day = options.true_wind(scenario, depart, truth)
        return options.wind_forecast(scenario, depart, self.wind, self.forecast, true, day), true
