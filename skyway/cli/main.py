"""``skyway``: the command line, its subcommands and exit codes.

Exit codes: 0 done, 1 the answer is no, 2 wrong usage or input, 3 the vehicle or link failed.
"""

from __future__ import annotations

import copy
import functools
import gc
import io
import os
import sys
from typing import Annotated, Any

import typer

from skyway import __version__
from skyway.cli import extras
from skyway.cli.command_groups import GROUPS, GroupedCommands, add_command
from skyway.cli.compiling import show_compiling
from skyway.cli.typed_words import BARE, fill, usage_words, with_command, with_new_names
from skyway.models.base.errors import SkywayError

USAGE_ERROR: type[Exception] = next(base for base in typer.BadParameter.__mro__ if base.__name__ == "ClickException")
"""Wrong usage: typer brings its own copy of click, or in older releases stands on the package."""

INTERRUPTED = 130
"""Exit code after Ctrl-C."""

app = typer.Typer(
    name="skyway",
    help="Plan, upload, fly and replay drone deliveries that must recharge on the way.",
    cls=GroupedCommands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
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


for names in GROUPS.values():
    for name in names:
        add_command(app, name)


def main(arguments: list[str] | None = None) -> int:
    """Run a command line and return its exit code; every error is one line per fault on stderr."""
    try:
        typed = with_new_names(sys.argv[1:] if arguments is None else arguments)
        typed = with_command(typed, {"weather": ("show", "verify", "fetch")})
        word = typed[0] if typed else ""
        code = _command_line(word)(fill(typed, BARE.get(word, {})), standalone_mode=False)
    except SkywayError as error:
        for line in str(error).splitlines():
            typer.echo(f"skyway: {line}", err=True)
        return error.exit_code
    except USAGE_ERROR as error:
        _tell_usage(error)
        return 2
    except ModuleNotFoundError as error:
        missing = extras.remedy(error)
        if missing is None:
            raise
        typer.echo(f"skyway: {missing}", err=True)
        return 2
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except OSError as error:  # standard output: whatever else fails has been made an `InputError`
        typer.echo(f"skyway: {error.strerror or error}", err=True)
        return 2
    if code == INTERRUPTED:
        typer.echo("skyway: interrupted", err=True)
    return code if isinstance(code, int) else 0


@functools.cache
def _command_line(word: str) -> Any:
    """Build the command that the first word names, since all together take longer than to start Python; else all of them."""
    one = copy.copy(app)
    one.registered_commands = [command for command in app.registered_commands if command.name == word]
    one.registered_groups = [group for group in app.registered_groups if group.name == word]
    return typer.main.get_command(one if one.registered_commands or one.registered_groups else app)


def _tell_usage(error: Exception) -> None:
    """Return what was typed wrongly, and where the right way stands; a bare command shows its help."""
    message = error.format_message()  # type: ignore[attr-defined]
    if type(error).__name__ == "NoArgsIsHelpError":
        typer.echo(message)
        return
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "skyway"
    typer.echo(f"skyway: {usage_words(error)} (see: {command} --help)", err=True)


def run() -> None:
    """Entry point of the ``skyway`` command."""
    gc.set_threshold(100_000, 5, 5)  # the many objects that imports make are all kept: do not look for waste so often
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without ° and … gets ? instead
    show_compiling()
    code = main()
    try:
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            typer.echo(f"skyway: standard output: {error.strerror}", err=True)
            code = code or 2
    gc.freeze()  # the process ends and everything is given back as a whole: do not look through it again, 0.3 s
    sys.exit(code)
