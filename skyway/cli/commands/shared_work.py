"""Options of commands whose work is distributed over processes or machines, and their progress line."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Callable

SAID_EVERY_S = 20.0
"""Interval between progress reports without a terminal."""

Workers = Annotated[
    int | None, typer.Option(help="Processes. Default: one for each processor.", min=1, max=1024)
]  # fmt: skip
Cluster = Annotated[str | None, typer.Option(help="Dask scheduler in place of processes: tcp://HOST:8786.")]


def processes(workers: int | None) -> int:
    """Return how many processes share the work."""
    from skyway.models.compute.spreading import processors

    return processors() if workers is None else workers


def progress(what: str) -> Callable[[int, int, float], None]:
    """Return a progress callback: one line rewritten on a terminal, else one now and then."""
    from skyway.models.base.formatting import duration

    shown = sys.stderr.isatty()
    said = [time.monotonic()]

    def tell(done: int, total: int, left_s: float) -> None:
        line = f"{done:,} of {total:,} {what}, about {duration(left_s)} left"
        if shown:
            end = "\r" + " " * 70 + "\r" if done == total else ""
            typer.echo(f"\r  {line:<66}{end}", nl=False, err=True)
        elif time.monotonic() >= said[0] + SAID_EVERY_S and done < total:
            said[0] = time.monotonic()
            typer.echo(line, err=True)

    return tell
