"""The command that lists what can be set: ``settings``."""

from __future__ import annotations

from typing import Annotated

import typer

from skyway.cli.views.sheet import Column, Sheet
from skyway.models.base.errors import InputError


def settings(
    name: Annotated[str, typer.Argument(help="Only those whose name begins so.")] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print them as JSON.")] = False,
) -> None:
    """List the tuned numbers of planners and filters, with default, unit, range and what set them.

    They are set for one command by --set name=value.

    Examples
    --------
      skyway settings
      skyway settings planner.robust --json
    """
    from dataclasses import asdict

    from skyway.models.base.json_text import json_text
    from skyway.models.base.parameters import entries, text_of
    from skyway.settings import Settings

    chosen = [one for one in entries(Settings()) if one.name.startswith(name)]
    if not chosen:
        raise InputError("no setting begins so", field="name", value=name, remedy="skyway settings lists them")
    if as_json:
        typer.echo(json_text({"schema": "skyway.settings/1", "settings": [asdict(one) for one in chosen]}, indent=1))
        return
    columns = [Column(head, justify="left") for head in ("name", "default", "unit", "range", "meaning")]
    sheet = Sheet(columns, names=1)
    for one in chosen:
        sheet.add(one.name, text_of(one.default), one.unit, one.range_text, one.meaning)
    sheet.show()
