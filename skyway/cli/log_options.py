"""What the commands that read logs share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skyway.cli import options

if TYPE_CHECKING:
    from link.logs.log import Log

LogFile = Annotated[Path, typer.Argument(help="Flight log: .tlog, .bin, .ulg or .csv.", show_default=False)]
Columns = Annotated[
    Path | None,
    typer.Option("--columns", help="For a CSV: TOML file that says which column is what.", show_default=False),
]
System = Annotated[
    int | None, typer.Option("--system", help="MAVLink system. Without it: the first.", show_default=False)
]
AsJson = Annotated[bool, typer.Option("--json", help="Answer as JSON.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite files.")]


def open_any(path: Path, columns: Path | None) -> Log:
    """Open a log of any format; says on stderr where its name tells another."""
    from link.logs.csv_log import read_columns
    from link.logs.reader import SUFFIX, open_log

    opened = open_log(path, None if columns is None else read_columns(columns))
    usual = SUFFIX[opened.summary.format]
    names = [part.lower().lstrip(".") for part in path.suffixes]
    if usual not in names:
        typer.echo(f"skyway: {path} is named otherwise, but is a .{usual}", err=True)
    return opened


def towards(text: str) -> tuple[float, float]:
    """Read ``SPEED@FROM`` as (north, east) TOWARDS, m/s."""
    from models.wind import vector

    north, east = vector(*options.parse_wind(text))
    return float(north), float(east)


def write(path: Path, text: str, *, force: bool) -> None:
    """Write a text file whole or not at all."""
    from models.files import write_atomically

    write_atomically(path, text, force=force)
