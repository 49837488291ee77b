"""Commands ``plan`` and ``compare``."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from skyway.cli import completion, options
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.formatting import duration
from skyway.planner.registry import CLAIRVOYANT_PLANNERS, FORECAST_PLANNERS, PLANNERS, ROBUST
from skyway.scenarios import load_scenario

if TYPE_CHECKING:
    from datetime import datetime

    from skyway.models.composition.composition import Recharge as RechargeMode
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.departure import Departure
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.problem.request import Request
    from skyway.planner.result import PlanResult

ScenarioArgument = Annotated[
    Path | None, typer.Argument(help="Scenario folder. Without it: New York, built in.", show_default=False)
]
From = Annotated[
    str,
    typer.Option(
        "--from",
        help="Start: station id, part of its name, or lat,lon.",
        show_default=False,
        autocompletion=completion.stations,
    ),
]
To = Annotated[
    str,
    typer.Option(
        "--to",
        help="Destination: station id, part of its name, or lat,lon.",
        show_default=False,
        autocompletion=completion.stations,
    ),
]
Payload = Annotated[float, typer.Option("--payload", help="Mass of the package, kg.", show_default=False)]
Depart = Annotated[
    str | None,
    typer.Option(
        "--depart", help="Departure with UTC offset, 2013-07-10T14:00-04:00. Without it: now.", show_default=False
    ),
]
Truth = Annotated[
    str | None,
    typer.Option(
        "--actual-wind",
        help="The wind that will really blow, for planners with perfect information: a day of the record (2013-07-10) or a forecast file with one member.",
        show_default=False,
    ),
]
Drone = Annotated[
    str | None,
    typer.Option(
        "--drone",
        help="Drone id. Without it the planner chooses.",
        show_default=False,
        autocompletion=completion.drones,
    ),
]
Reserve = Annotated[float, typer.Option("--reserve", help="Least charge at any landing, percent.")]
Soc = Annotated[float, typer.Option("--soc", help="Charge at the start, percent.")]
Airspeed = Annotated[
    float | None, typer.Option("--airspeed", help="Planned airspeed, m/s. Without it: the drone's.", show_default=False)
]
WindOption = Annotated[
    str | None,
    typer.Option("--wind", help="One constant wind at cruise height, m/s@degrees FROM: 8@270.", show_default=False),
]
Forecast = Annotated[
    Path | None,
    typer.Option("--forecast", help="Forecast file: time, site, member, speed_mps, from_deg.", show_default=False),
]
Recharge = Annotated[
    str,
    typer.Option("--recharge", help="At each stop charge to 100 % (full) or to what the next flight needs (enough)."),
]
ObjectiveOption = Annotated[
    str,
    typer.Option(
        "--objective", help="mean, p95, or on-time with a deadline: 'on-time 2013-07-10T16:00-04:00' (planner robust)."
    ),
]
Seed = Annotated[int, typer.Option("--seed", help="Random seed of all sampling.", min=0, max=2**32 - 1)]
TimeLimit = Annotated[float, typer.Option("--time-limit", help="Time limit of `ies` and `exact` for each drone, s.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite files.")]

PLAN_HELP = """Plan a delivery that recharges on the way, under real wind and pad queues.

\b
Examples:
  skyway plan --from siuh-north --to white-plains --payload 0.8 --depart 2013-07-10T14:00-04:00
  skyway plan --from edison --to Syosset --payload 2 --depart 2013-07-10T14:00-04:00 --wind 8@270 --json
  skyway plan --from bellevue --to jacobi --payload 0.8 --objective 'on-time 2030-07-10T16:00-04:00' --depart 2030-07-10T14:30-04:00
  skyway plan --from bellevue --to white-plains --payload 0.8 --depart-window 3h --alternatives 3 --explain
  skyway plan my-scenario --from depot --to clinic --payload 1.2 -o plan.json --plot plan.png
"""
PLANNER_HELP = (
    f"{', '.join((ROBUST, *FORECAST_PLANNERS))}; with perfect information: {', '.join(CLAIRVOYANT_PLANNERS)}."
)
COMPARE_HELP = """Compare several planners on the same request.

\b
Examples:
  skyway compare --from bellevue --to white-plains --payload 0.8 --depart 2013-07-10T14:00-04:00 --drone m200
  skyway compare --planners pfs,shortest,ies --from bellevue --to jacobi --payload 0.8 --wind 8@270 --json
"""


def register(app: typer.Typer) -> None:
    """Add the commands to the command line."""
    app.command("plan", help=PLAN_HELP)(plan)
    app.command("compare", help=COMPARE_HELP)(compare)


def plan(
    start: From,
    to: To,
    payload: Payload,
    scenario: ScenarioArgument = None,
    depart: Depart = None,
    planner: Annotated[
        str,
        typer.Option(
            "--planner",
            help=PLANNER_HELP,
            autocompletion=completion.planners,
        ),
    ] = "robust",
    objective: ObjectiveOption = "mean",
    depart_window: Annotated[
        str | None,
        typer.Option(
            "--depart-window",
            help="Choose the best departure within this time after --depart: 90min, 2h.",
            show_default=False,
        ),
    ] = None,
    truth: Truth = None,
    drone: Drone = None,
    reserve: Reserve = 20.0,
    soc: Soc = 100.0,
    airspeed: Airspeed = None,
    wind: WindOption = None,
    forecast: Forecast = None,
    recharge: Recharge = "enough",
    seed: Seed = 0,
    time_limit: TimeLimit = 60.0,
    settings: options.Settings = None,
    alternatives: Annotated[
        int, typer.Option("--alternatives", help="Largest number of different plans to show.", min=1, max=9)
    ] = 1,
    explain: Annotated[
        bool, typer.Option("--explain", help="Explain each stop and its charge, and show the next best plan.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the composition as JSON.")] = False,
    geojson: Annotated[
        Path | None, typer.Option("--geojson", help="Write the route as GeoJSON.", show_default=False)
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", help="Draw the route: FILE.png or FILE.svg.", show_default=False)
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write the composition to a file.", show_default=False)
    ] = None,
    force: Force = False,
) -> None:
    """Plan one delivery."""
    from skyway.models.composition.file import save, to_json

    options.refuse_overwriting(output, geojson, plot, force=force)
    options.check_picture(plot)
    _check_planners([planner], "--planner")
    parameters = options.planner_parameters(settings)
    world = load_scenario(scenario)
    asked = _ask(world, start, to, payload, depart, drone, reserve, soc, airspeed, recharge, seed, objective)
    tried: list[Departure] = []
    if depart_window is None:
        result = _solve(*asked, planner, wind, forecast, truth, time_limit, parameters, quiet=as_json)
    else:
        result, tried = _solve_window(*asked, depart_window, planner, wind, forecast, truth, parameters, quiet=as_json)
    options.hint_at_warnings(world, scenario)
    composition = result.composition
    if output is not None:
        save(composition, output, force=force)
    if geojson is not None:
        from skyway.route_geojson import route_geojson

        _write(geojson, json.dumps(route_geojson(composition), indent=1, allow_nan=False) + "\n", force=force)
    if plot is not None:
        from skyway.plots.charge_band import charge_band
        from skyway.plots.map import plot_composition

        plot_composition(composition, result.problem.scenario, plot, charge_band(result))
    options.say_written(output, geojson, plot)
    from skyway.cli.views import plan_reasons
    from skyway.planner.report import plan_report

    report = plan_report(result, tried, alternatives, explain=explain)

    if as_json:
        document = to_json(composition) | plan_reasons.as_json(report)
        typer.echo(json.dumps(document, indent=1, allow_nan=False))
        return
    from skyway.cli.views.plan import print_plan

    print_plan(report)
    plan_reasons.print_more(report)


def compare(
    start: From,
    to: To,
    payload: Payload,
    scenario: ScenarioArgument = None,
    planners: Annotated[
        str, typer.Option("--planners", help="Names of planners, separated by commas.")
    ] = "robust,pfs,pfs-charge-aware,shortest,ies",
    depart: Depart = None,
    truth: Truth = None,
    drone: Drone = None,
    reserve: Reserve = 20.0,
    soc: Soc = 100.0,
    airspeed: Airspeed = None,
    wind: WindOption = None,
    forecast: Forecast = None,
    recharge: Recharge = "enough",
    seed: Seed = 0,
    time_limit: TimeLimit = 60.0,
    settings: options.Settings = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
) -> None:
    """Compare planners on one request."""
    from skyway.models.base.errors import InfeasibleError
    from skyway.models.composition.file import to_json
    from skyway.planner.result import Comparison

    names = [name.strip() for name in planners.split(",") if name.strip()]
    _check_planners(names, "--planners")
    parameters = options.planner_parameters(settings)
    world = load_scenario(scenario)
    asked = _ask(world, start, to, payload, depart, drone, reserve, soc, airspeed, recharge, seed)
    answers: list[Comparison] = []
    for name in names:
        try:
            result = _solve(*asked, name, wind, forecast, truth, time_limit, parameters, quiet=as_json)
            answers.append(Comparison(name, result, None))
        except InfeasibleError as error:
            answers.append(Comparison(name, None, error))
    options.hint_at_warnings(world, scenario)
    if as_json:
        plans = [
            {
                "planner": answer.planner,
                "status": "ok" if answer.result else "infeasible",
                "error": None if answer.error is None else str(answer.error),
                "composition": None if answer.result is None else to_json(answer.result.composition),
            }
            for answer in answers
        ]
        typer.echo(json.dumps({"schema": "skyway.compare/1", "plans": plans}, indent=1, allow_nan=False))
    else:
        from skyway.cli.views.comparison import print_comparison

        print_comparison(answers)
    if all(answer.result is None for answer in answers):
        raise typer.Exit(1)


def _ask(
    scenario: Scenario,
    start: str,
    to: str,
    payload: float,
    depart: str | None,
    drone: str | None,
    reserve: float,
    soc: float,
    airspeed: float | None,
    recharge: str,
    seed: int,
    objective: str = "mean",
) -> tuple[Scenario, Request]:
    """Turn what was typed into a request; targets given as lat,lon join the scenario's network."""
    from skyway.models.composition.composition import State
    from skyway.planner.problem.request import Request

    scenario, origin = options.place(scenario, start, "--from")
    scenario, destination = options.place(scenario, to, "--to")
    state = State(options.parse_depart(depart), origin, None, options.percent(soc, "--soc"))
    with options.as_typed():
        request = Request(
            state=state,
            destination=destination,
            payload_kg=payload,
            drone=drone,
            airspeed_mps=airspeed,
            reserve_soc=options.percent(reserve, "--reserve", high=95.0),
            recharge=cast("RechargeMode", recharge),
            seed=seed,
            objective=options.parse_objective(objective),
        )
    return scenario, request


def _solve(
    scenario: Scenario,
    request: Request,
    planner: str,
    wind: str | None,
    forecast: Path | None,
    truth: str | None,
    time_limit_s: float,
    parameters: PlannerParameters,
    *,
    quiet: bool,
) -> PlanResult:
    """Plan with the wind that was asked for."""
    from skyway.planner.plan import plan as plan_delivery

    if not time_limit_s > 0:
        raise InputError(Fault("must be above 0", field="--time-limit", value=time_limit_s))
    depart = request.state.time
    if truth is None and planner in CLAIRVOYANT_PLANNERS and wind is None and forecast is None:
        truth = _own_day(scenario, request)
    show = None if quiet or not sys.stderr.isatty() else _progress
    with options.as_typed():
        true, day = options.true_wind(scenario, depart, truth)
        known = options.wind_forecast(scenario, depart, wind, forecast, true, day)
        result = plan_delivery(
            scenario, request, planner=planner, forecast=known, truth=true, time_limit_s=time_limit_s, progress=show,
            parameters=parameters,
        )  # fmt: skip
    if show is not None and planner in CLAIRVOYANT_PLANNERS:
        typer.echo("\r" + " " * 60 + "\r", nl=False, err=True)
    return result


def _solve_window(
    scenario: Scenario,
    request: Request,
    window: str,
    planner: str,
    wind: str | None,
    forecast: Path | None,
    truth: str | None,
    parameters: PlannerParameters,
    *,
    quiet: bool,
) -> tuple[PlanResult, list[Departure]]:
    """Plan for the best departure of a window."""
    from skyway.planner.departure import plan_within

    if planner in CLAIRVOYANT_PLANNERS or truth is not None:
        remedy = "robust or one of the pfs planners, without --actual-wind"
        raise InputError(
            Fault(
                "cannot be combined with planners that have perfect information", field="--depart-window", remedy=remedy
            )
        )
    length_s = options.parse_duration(window, "--depart-window")

    def known(depart: datetime) -> WindEnsemble:
        return options.wind_forecast(scenario, depart, wind, forecast, None, None)

    show = None if quiet or not sys.stderr.isatty() else _window_progress
    with options.as_typed():
        found = plan_within(
            scenario, request, length_s, planner=planner, forecast=known, progress=show, parameters=parameters
        )
    if show is not None:
        typer.echo("\r" + " " * 60 + "\r", nl=False, err=True)
    return found


def _window_progress(done: int, count: int) -> None:
    typer.echo(f"\r  {done} of {count} departures ", nl=False, err=True)


def _own_day(scenario: Scenario, request: Request) -> str | None:
    """Local date of the departure, where the record holds its wind: then that is the truth."""
    from zoneinfo import ZoneInfo

    from skyway.planner.problem.problem import HORIZON_H

    day = request.state.time.astimezone(ZoneInfo(scenario.timezone)).date()
    try:
        scenario.truth(day, request.state.time, HORIZON_H)
    except InputError:
        return None
    return day.isoformat()


def _progress(labels_expanded: int, best_s: float) -> None:
    best = "none yet" if best_s == float("inf") else duration(best_s)
    typer.echo(f"\r  {labels_expanded} sequences, best {best} ", nl=False, err=True)


def _check_planners(names: list[str], option: str) -> None:
    known = ", ".join(PLANNERS)
    faults = [
        Fault("no such planner", field=option, value=name, remedy=f"one of {known}")
        for name in names
        if name not in PLANNERS
    ]
    if not names:
        faults = [Fault("no planner named", field=option, remedy=f"one or more of {known}")]
    if faults:
        raise InputError(faults)


def _write(path: Path, text: str, *, force: bool) -> None:
    from skyway.models.base.files import write_atomically

    write_atomically(path, text, force=force)
