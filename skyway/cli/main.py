"""``skyway``: one command, its subcommands, and what it exits with.

Exit codes: 0 done, 1 the answer is no, 2 wrong usage or input, 3 the vehicle or link failed.
"""

from __future__ import annotations

import os
import sys
from typing import Annotated

import click
import typer

from models.errors import SkywayError
from skyway import __version__
from skyway.cli import mission_commands, plan_commands, scenario_commands

app = typer.Typer(
    name="skyway",
    help="Plan, upload, fly and replay drone deliveries that must recharge on the way.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(value: bool) -> None:
    if value:
        typer.echo(f"skyway {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Plan, upload, fly and replay drone deliveries that must recharge on the way."""


for commands in (plan_commands, scenario_commands, mission_commands):
    commands.register(app)


def main(arguments: list[str] | None = None) -> int:
    """Run a command line and return its exit code; every error is one line per fault on stderr."""
    try:
        code = app(arguments, standalone_mode=False)
    except SkywayError as error:
        for line in str(error).splitlines():
            typer.echo(f"skyway: {line}", err=True)
        return error.exit_code
    except click.exceptions.NoArgsIsHelpError as error:
        typer.echo(error.format_message())
        return 2
    except click.ClickException as error:
        typer.echo(f"skyway: {error.format_message()}", err=True)
        return 2
    except (KeyboardInterrupt, click.Abort):
        typer.echo("skyway: interrupted", err=True)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return code if isinstance(code, int) else 0


def run() -> None:
    """Entry point of the ``skyway`` command."""
    sys.exit(main())
