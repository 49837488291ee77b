"""The commands of skyway, and the groups that ``skyway --help`` lists them in."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import typer
from typer.core import TyperGroup

if TYPE_CHECKING:
    from collections.abc import Mapping

GROUPS: Mapping[str, Mapping[str, str]] = {
    "Plan": {
        "plan": "plan",
        "compare": "plan",
        "evaluate": "plan",
        "dispatch": "fleet.dispatch",
        "orders": "fleet.orders",
        "study": "fleet.study",
        "wind": "scenario",
        "forecast": "forecast",
        "weather": "forecast",
        "network": "scenario",
        "airspace": "scenario",
        "scenario": "scenario",
        "terrain": "terrain",
    },
    "Missions": {
        "mission": "mission",
        "check": "check",
        "recharge": "check",
        "convert": "mission",
        "show": "mission",
    },
    "Vehicles": {
        "upload": "link",
        "download": "link",
        "verify": "link",
        "clear": "link",
        "watch": "link",
        "params": "aboard.parameters",
        "logs": "aboard.logs",
        "health": "aboard.health",
    },
    "Fly": {"fly": "fly", "demo": "demo", "report": "report", "sim": "sim"},
    "Page": {"serve": "demo"},
    "Logs and measurements": {"replay": "replay", "calibrate": "calibrate", "bench": "bench", "settings": "bench"},
}
"""Headings; under each its commands in order, with the module of `skyway.cli.commands` that holds them."""
_HEAD, _SHOWN_HEAD = "Examples\n    --------\n", "\b\n    Examples:\n"
"""Head of the examples in a docstring, and in a help text; ``\\b`` keeps their lines."""


def add_command(app: typer.Typer, name: str) -> None:
    """Add a command to a command line: a function, or a group of commands, of its name in its module."""
    module = next(commands[name] for commands in GROUPS.values() if name in commands)
    command = getattr(import_module(f"skyway.cli.commands.{module}"), name)
    if isinstance(command, typer.Typer):
        app.add_typer(command, name=name)
        added = command.registered_commands
    else:
        app.command(name)(command)
        added = app.registered_commands[-1:]
    for one in added:
        one.help = (one.callback.__doc__ or "").replace(_HEAD, _SHOWN_HEAD)
        one.short_help = _sentence(one.help)  # whole, where click would cut it


class GroupedCommands(TyperGroup):
    """The commands of skyway under headings."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002  typer's Context, or click's in older releases
        """Write one section for each group."""
        for heading, names in GROUPS.items():
            with formatter.section(heading):
                formatter.write_dl([(name, _sentence(self.commands[name].help or "")) for name in names], col_max=12)


def _sentence(help_text: str) -> str:
    """Return the first sentence of a help text, on one line."""
    return " ".join(help_text.split("\n\n", maxsplit=1)[0].split()).split(". ", maxsplit=1)[0].rstrip(".")
