"""The command that shows everything at once: ``demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

DEMO_HELP = """Show a whole delivery: planned, flown by a simulated vehicle in another wind than forecast, replanned, delivered.

No vehicle, no network and no waiting: everything runs in virtual time. Another day or seed tells another story.

\b
Examples:
  skyway demo
  skyway demo --day 2013-05-20 --seed 3 --autopilot ardupilot -o out/other
"""


def demo(
    day: Annotated[str | None, typer.Option("--day", help="Day of 2013 whose wind blows.", show_default=False)] = None,
    seed: Annotated[int, typer.Option("--seed", help="Of gusts, other drones and errors.")] = 1,
    autopilot: Annotated[Literal["px4", "ardupilot"], typer.Option("--autopilot", help="Whose behaviour.")] = "px4",
    planner: Annotated[str, typer.Option("--planner", help="Planner; without it the default one.")] = "",
    plan_only: Annotated[bool, typer.Option("--plan-only", help="Plan and do not fly: compiles the kernels.")] = False,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for plan, journal and report.")] = Path(
        "out/demo"
    ),
) -> None:
    """Show a whole delivery (the help text is `DEMO_HELP`)."""
    from skyway.demo import DemoOptions, plan_demo, run_demo, tell_end, with_day

    options = with_day(DemoOptions(folder=output, seed=seed, autopilot=autopilot, planner=planner), day)
    if plan_only:
        typer.echo(str(plan_demo(options)))
        return
    outcome = run_demo(options, typer.echo)
    for line in tell_end(options, outcome):
        typer.echo(line)
    if outcome.exit_code:
        raise typer.Exit(outcome.exit_code)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("demo", help=DEMO_HELP)(demo)
