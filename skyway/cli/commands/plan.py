"""Commands ``plan``, ``compare`` and ``evaluate``."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from skyway import typed_values
from skyway.cli import completion, options
from skyway.cli.commands.shared_work import Cluster, Workers, processes, progress
from skyway.cli.option_groups import with_groups
from skyway.cli.request_options import ConditionOptions, Depart, PadOptions, RequestOptions
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import duration
from skyway.models.base.json_text import json_text
from skyway.planner.registry import CLAIRVOYANT_PLANNERS, FORECAST_PLANNERS, ROBUST
from skyway.planning import Conditions, solve, solve_window, with_pads

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from skyway.planner.departure import Departure
    from skyway.planner.report import PlanReport

PLANNER_HELP = (
    f"{', '.join((ROBUST, *FORECAST_PLANNERS))}; with perfect information: {', '.join(CLAIRVOYANT_PLANNERS)}."
)
OBJECTIVE_HELP = (
    "mean, p95, energy, cost, a sum such as 'cost + 12/h*time + 0.3/kWh*energy', several in order such as 'cost within 5%, then mean', "
    "or on-time with a deadline: 'on-time 2013-07-10T16:00-04:00' (planner robust)."
)
WORTH = 30
"""So many parts of an evaluation take longer than processes take to begin."""
TimeLimit = Annotated[
    float, typer.Option("--time-limit", help="Time limit of `ies` and `exact` for each drone, and of `robust`, s.")
]


@with_groups
def plan(
    asked: RequestOptions,
    conditions: ConditionOptions,
    pads: PadOptions,
    planner: Annotated[str, typer.Option(help=PLANNER_HELP, autocompletion=completion.planners)] = "robust",
    objective: Annotated[
        str,
        typer.Option(help=OBJECTIVE_HELP),
    ] = "mean",
    depart_window: Annotated[
        str | None, typer.Option(help="Choose the best departure within this time after --depart: 90min, 2h.")
    ] = None,
    time_limit: TimeLimit = 60.0,
    settings: options.Settings = None,
    alternatives: Annotated[int, typer.Option(help="Largest number of different plans to show.", min=1, max=9)] = 1,
    explain: Annotated[
        bool, typer.Option("--explain", help="Explain each stop and its charge, and the basis of the promise.")
    ] = False,
    as_flown: Annotated[
        int,
        typer.Option(
            help="Simulate this number of deliveries with the decisions of `fly` and wind errors between the sites, and show their arrival times (planner robust), at least 20; half a second to some seconds each.",
            metavar="N",
            min=0,
        ),
    ] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the composition as JSON.")] = False,
    geojson: Annotated[Path | None, typer.Option(help="Write the route as GeoJSON.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the route: FILE.png or FILE.svg.")] = None,
    kml: Annotated[Path | None, typer.Option(help="Write the route as KML.")] = None,
    briefing: Annotated[Path | None, typer.Option(help="Write a briefing to print: FILE.html.")] = None,
    contact: Annotated[list[str] | None, typer.Option(help="Line under Contacts of the briefing; repeatable.")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the composition to a file.")] = None,
    force: options.Force = False,
) -> None:
    """Plan a delivery that recharges on the way, under real wind and pad queues.

    Examples
    --------
      skyway plan --from siuh-north --to white-plains --payload 0.8 --depart 2013-07-10T14:00-04:00
      skyway plan --from edison --to Syosset --payload 2 --depart 2013-07-10T14:00-04:00 --wind 8@270 --json
      skyway plan --from edison --to Syosset --payload 2 --observed metars.txt --observed LGA=9@310 --pads tcp:127.0.0.1:5790
      skyway plan --from bellevue --to jacobi --payload 0.8 --objective 'on-time 2030-07-10T16:00-04:00' --depart 2030-07-10T14:30-04:00
      skyway plan --from bellevue --to white-plains --payload 0.8 --depart-window 3h --alternatives 3 --explain
      skyway plan --from siuh-north --to white-plains --payload 0.8 --depart 2013-07-10T14:00-04:00 --as-flown 100
      skyway plan my-scenario --from depot --to clinic --payload 1.2 -o plan.json --plot plan.png
    """
    from skyway.cli.views import plan_reasons
    from skyway.plan_document import plan_document
    from skyway.planner.report import plan_report

    files = _Files(output, geojson, kml, briefing, plot)
    _check_asked(files, contact, as_flown, force=force)
    typed_values.check_planners([planner], "--planner")
    parameters = typed_values.planner_parameters(settings)
    world = conditions.loaded()
    request = asked.request(world, conditions.instant, objective)
    tried: list[Departure] = []
    if depart_window is None:
        (world, wanted), busy = with_pads(request, conditions, pads)
        with _shown(_sequences, quiet=as_json) as progress:
            result = solve(
                world, wanted, conditions, planner,
                time_limit_s=time_limit, parameters=parameters, busy=busy, progress=progress,
            )  # fmt: skip
    else:
        if pads.pads is not None:
            problem = "cannot be combined with --depart-window: current pads say little about other departures"
            raise InputError(problem, field="--pads", value=pads.pads, remedy="remove one of them")
        with _shown(_departures, quiet=as_json) as progress:
            result, tried = solve_window(
                *request, conditions, depart_window, planner, parameters=parameters, progress=progress
            )
    with _shown(_deliveries, quiet=as_json) as progress, typed_values.as_typed():
        report = plan_report(result, tried, alternatives, explain=explain, flown_runs=as_flown, told=progress)
    options.hint_at_warnings(world, conditions.scenario)
    _write(files, report, contact or (), force=force)
    options.say_written(*files)
    if as_json:
        typer.echo(json_text(plan_document(report), indent=1))
        return
    from skyway.cli.views.plan import print_plan

    print_plan(report)
    plan_reasons.print_more(report)


class _Files(NamedTuple):
    """Files that a plan is written to."""

    output: Path | None
    geojson: Path | None
    kml: Path | None
    briefing: Path | None
    plot: Path | None


def _check_asked(files: _Files, contact: list[str] | None, as_flown: int, *, force: bool) -> None:
    """Refuse what could not be written or shown, before the planning."""
    from skyway.planner.evaluation.as_flown import check_flown_runs

    options.refuse_overwriting(*files, force=force)
    options.check_picture(files.plot)
    page = files.briefing
    if page is not None and page.suffix.lower() not in (".html", ".htm"):
        remedy = "a name that ends in .html"
        raise InputError("cannot write this format", field="--briefing", value=page.name, remedy=remedy)
    if contact and page is None:
        remedy = "give --briefing FILE.html, too"
        raise InputError("goes with --briefing", field="--contact", value=contact[0], remedy=remedy)
    with typed_values.as_typed():
        check_flown_runs(as_flown)


def _write(files: _Files, report: PlanReport, contact: Sequence[str], *, force: bool) -> None:
    """Write a plan to the files asked for."""
    from skyway.models.base.files import write_atomically
    from skyway.plan_document import plan_document

    result = report.result
    composition, scenario = result.composition, result.problem.scenario
    if files.output is not None:
        write_atomically(files.output, json_text(plan_document(report), indent=1) + "\n", force=force)
    if files.geojson is not None:
        from skyway.route_geojson import route_geojson

        write_atomically(files.geojson, json_text(route_geojson(composition), indent=1) + "\n", force=force)
    if files.kml is not None:
        from skyway.route_kml import route_kml

        write_atomically(files.kml, route_kml(composition), force=force)
    if files.briefing is not None:
        from skyway.briefing import briefing
        from skyway.plan_document import between_sites_words

        doubt = report.between_sites
        caveat = "" if doubt is None else " ".join(between_sites_words(doubt, result.problem.epsilon))
        page = briefing(composition, scenario, contact, [caveat] if caveat else ())
        write_atomically(files.briefing, page, force=force)
    if files.plot is not None:
        from skyway.plots.charge_band import charge_band
        from skyway.plots.map import plot_composition

        plot_composition(composition, scenario, files.plot, charge_band(result))


@with_groups
def compare(
    asked: RequestOptions,
    conditions: ConditionOptions,
    pads: PadOptions,
    planners: Annotated[
        str, typer.Option(help="Names of planners, separated by commas.")
    ] = "robust,pfs,pfs-charge-aware,shortest,ies",
    objective: Annotated[
        str, typer.Option(help="Objective of robust, see skyway plan; the others minimize the time.")
    ] = "mean",
    time_limit: TimeLimit = 60.0,
    settings: options.Settings = None,
    as_json: options.AsJson = False,
) -> None:
    """Compare several planners on the same request.

    Examples
    --------
      skyway compare --from bellevue --to white-plains --payload 0.8 --depart 2013-07-10T14:00-04:00 --drone m200
      skyway compare --from bellevue --to white-plains --payload 0.8 --observed metars.txt --observed LGA=9@310
      skyway compare --planners pfs,shortest,ies --from bellevue --to jacobi --payload 0.8 --wind 8@270 --json
    """
    from skyway.cli.views.comparison import document_of, print_comparison
    from skyway.models.base.errors import InfeasibleError
    from skyway.now import told_conditions
    from skyway.planner.plan import as_planned_by
    from skyway.planner.report import comparison_report
    from skyway.planner.result import Comparison

    names = [name.strip() for name in planners.split(",") if name.strip()]
    typed_values.check_planners(names, "--planners")
    parameters = typed_values.planner_parameters(settings)
    world = conditions.loaded()
    (world, wanted), busy = with_pads(asked.request(world, conditions.instant, objective), conditions, pads)
    answers: list[Comparison] = []
    for name in names:
        try:
            with _shown(_sequences, quiet=as_json) as progress:
                result = solve(
                    world, as_planned_by(name, wanted), conditions, name,
                    time_limit_s=time_limit, parameters=parameters, busy=busy, progress=progress,
                )  # fmt: skip
            answers.append(Comparison(name, result, None))
        except InfeasibleError as error:
            answers.append(Comparison(name, None, error))
    options.hint_at_warnings(world, conditions.scenario)
    report = comparison_report(answers)
    if as_json:
        typer.echo(json_text(document_of(report), indent=1))
    else:
        print_comparison(report)
        known, _ = conditions.winds(world, wanted.state.time, conditions.truth)
        seen = () if busy is None else busy.conditions
        for note in (*told_conditions((*known.conditions, *seen)), *known.notes, *(() if busy is None else busy.notes)):
            typer.echo(f"Note: {note}")
    if all(answer.result is None for answer in answers):
        raise typer.Exit(1)


def _no_plan_file(scenario: Path | None) -> Path | None:
    """Refuse the file of a plan where a scenario is expected, before the options of the request are missed."""
    if scenario is not None and scenario.suffix == ".json":
        remedy = "evaluate plans the request itself: --from, --to, --payload and, in a scenario of your own, its folder"
        raise InputError("is not a scenario", str(scenario), remedy=remedy)
    return scenario


@with_groups
def evaluate(
    asked: RequestOptions,
    scenario: Annotated[
        Path | None,
        typer.Argument(help="Scenario folder. Default: New York, built in.", callback=_no_plan_file),
    ] = None,
    depart: Depart = None,
    planner: Annotated[
        str, typer.Option(help=f"{', '.join((ROBUST, *FORECAST_PLANNERS))}.", autocompletion=completion.planners)
    ] = ROBUST,
    days: Annotated[
        int, typer.Option(help="Days of the season that are held out of the forecast.", min=2, max=60)
    ] = 12,
    runs: Annotated[int, typer.Option(help="Simulated deliveries, distributed over these days.", min=2)] = 1000,
    online: Annotated[
        bool,
        typer.Option("--online", help="Fly the online policy, which decides at each stop; seconds for each delivery."),
    ] = False,
    workers: Workers = None,
    cluster: Cluster = None,
    terrain: options.TerrainFiles = None,
    obstacles: options.ObstacleFiles = None,
    zones: options.Zones = None,
    authorized: options.Authorized = None,
    settings: options.Settings = None,
    as_json: options.AsJson = False,
) -> None:
    """Plan a request, and simulate the plan on days of the wind record that are held out of its forecast.

    Prints delivery times, landings below the reserve and kept promises, each with a 95 % interval over the days. Deliveries are distributed
    over processes, or a Dask cluster; their number does not change the figures.

    Examples
    --------
      skyway evaluate --from siuh-north --to white-plains --payload 0.8 --depart 2013-07-10T14:00-04:00
      skyway evaluate --from bellevue --to jacobi --payload 0.8 --depart 2013-07-10T14:00-04:00 --planner pfs --runs 200
      skyway evaluate --from bellevue --to jacobi --payload 0.8 --depart 2013-07-10T14:00-04:00 --online --runs 24
      skyway evaluate --from bellevue --to jacobi --payload 0.8 --depart 2013-07-10T14:00-04:00 --runs 1000000 --cluster tcp://127.0.0.1:8786
    """
    from dataclasses import replace

    from skyway.models.base.parameters import changed
    from skyway.models.base.units import iso
    from skyway.planner.evaluation.evaluate import evaluate as evaluated
    from skyway.planner.evaluation.evaluate import summarise
    from skyway.planner.evaluation.parts import PART, fly_parts
    from skyway.planner.evaluation.realizations import held_out_forecast, sample_realizations, season_days
    from skyway.planner.online.evaluated import RollingRobust
    from skyway.planner.plan import plan

    typed_values.check_planners([planner], "--planner", (ROBUST, *FORECAST_PLANNERS))
    if online and planner != ROBUST:
        remedy = "leave out one of them"
        raise InputError(
            "--online flies the online policy, not a plan", field="--planner", value=planner, remedy=remedy
        )
    parameters = typed_values.planner_parameters(settings)
    where = Conditions(
        scenario=scenario, depart=depart, terrain=terrain, obstacles=obstacles, zones=zones, authorized=authorized
    )
    world, request = asked.request(where.loaded(), where.instant)
    with typed_values.as_typed():
        held_out = season_days(world, request, days, seed=request.seed)
        try:
            forecast = held_out_forecast(world, request, held_out)
        except InputError as error:  # with fewer days there is one: `season_days` chose among its days
            remedy = f"hold out fewer days: {len(held_out)} of them, two days apart, leave none of the season to forecast from"
            raise InputError(str(error.faults[0].problem), field="--days", value=days, remedy=remedy) from None
        result = plan(world, request, planner=planner, forecast=forecast, parameters=parameters)
        request = replace(request, drone=result.composition.drone)
        realizations = sample_realizations(world, request, held_out, runs=runs, seed=request.seed)
        told = progress("deliveries simulated")
        count = processes(workers) if workers is not None or online or runs >= WORTH * PART else 1
        if online:
            policy = RollingRobust(result.problem)
            flown = fly_parts(realizations, result.composition.drone, policy, workers=count, cluster=cluster, told=told)
            found = summarise("online policy", flown, replicates=parameters.evaluation.replicates)
        else:
            found = evaluated(result, realizations, workers=count, cluster=cluster, told=told)
    if not as_json:
        typer.echo(found.summary())
        return
    asked_of = {
        "scenario": {"path": world.path, "sha256": world.sha256}, "from": request.state.station, "to": request.destination,
        "payload_kg": request.payload_kg, "drone": request.drone, "depart": iso(request.state.time), "seed": request.seed,
        "held_out": [day.isoformat() for day in held_out], "parameters": changed(parameters, "planner"),
    }  # fmt: skip
    typer.echo(json_text(found.document() | asked_of, indent=1))


def _sequences(labels_expanded: int, best_s: float) -> None:
    best = "none yet" if best_s == float("inf") else duration(best_s)
    typer.echo(f"\r  {labels_expanded} sequences, best {best} ", nl=False, err=True)


def _departures(done: int, count: int) -> None:
    typer.echo(f"\r  {done} of {count} departures ", nl=False, err=True)


def _deliveries(done: int, count: int, left_s: float) -> None:
    typer.echo(f"\r  {done} of {count} deliveries simulated, {duration(left_s)} left ", nl=False, err=True)


@contextmanager
def _shown(progress: Callable[..., None], *, quiet: bool) -> Iterator[Callable[..., None] | None]:
    """Yield what shows progress, where a person watches a terminal, and wipe the line at the end."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    yield progress
    typer.echo("\r" + " " * 60 + "\r", nl=False, err=True)
