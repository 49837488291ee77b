"""The list of commands in ``skyway --help``, in groups."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from typer.core import TyperGroup

if TYPE_CHECKING:
    from collections.abc import Mapping

GROUPS: Mapping[str, Mapping[str, str]] = {
    "Plan": {
        "plan": "plan",
        "compare": "plan",
        "wind": "scenario",
        "forecast": "forecast",
        "network": "scenario",
        "scenario": "scenario",
    },
    "Missions": {"mission": "mission", "check": "mission", "convert": "mission", "show": "mission"},
    "Vehicles": {
        "upload": "link",
        "download": "link",
        "verify": "link",
        "clear": "link",
        "watch": "link",
        "params": "link",
    },
    "Fly": {"fly": "fly", "demo": "demo", "report": "report", "sim": "sim"},
    "Logs and measurements": {"replay": "replay", "calibrate": "calibrate", "bench": "bench", "settings": "settings"},
}
"""Headings; under each its commands in order, with the module of `skyway.cli.commands` that holds them."""
MODULES = tuple(dict.fromkeys(module for commands in GROUPS.values() for module in commands.values()))
"""Modules of commands, each once."""


class GroupedCommands(TyperGroup):
    """The commands of skyway under headings; a command that no group names comes last."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # typer's own Context, or click's in older releases
        """Write one section for each group."""
        shown = {name: command for name in self.list_commands(ctx) if not (command := self.commands[name]).hidden}
        grouped = {name for names in GROUPS.values() for name in names}
        others = {"Other": tuple(name for name in shown if name not in grouped)}
        for heading, names in {**GROUPS, **others}.items():
            rows = [(name, _sentence(shown[name].help or "")) for name in names if name in shown]
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows, col_max=12)


def _sentence(help_text: str) -> str:
    """Return the first sentence of a help text, on one line."""
    return " ".join(help_text.split("\n\n", maxsplit=1)[0].split()).split(". ", maxsplit=1)[0].rstrip(".")
