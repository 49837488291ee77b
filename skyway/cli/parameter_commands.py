"""Commands about a vehicle's parameters: ``params get``, ``params set`` and ``params diff``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from skyway.cli.link_commands import (
    DEFAULT_CONNECT,
    RECORDINGS,
    Autopilot,
    Connect,
    Ground,
    KeyFile,
    Record,
    System,
    Yes,
    aboard,
)

params = typer.Typer(help="Read, set and compare parameters.", no_args_is_help=True)


@params.command("get")
def params_get(
    names: Annotated[list[str] | None, typer.Argument(help="Names; none for all.", show_default=False)] = None,
    connect: Connect = DEFAULT_CONNECT,
    system: System = None,
    ground: Ground = 255,
    key_file: KeyFile = None,
    record: Record = RECORDINGS,
) -> None:
    """Print parameters as NAME,VALUE lines, which ground stations read.

    \b
    Examples:
      skyway params get > all.param
      skyway params get RTL_ALT FS_OPTIONS --connect tcp:127.0.0.1:5760
    """  # noqa: D301
    with aboard(connect, system, Autopilot.AUTO, ground, key_file, record) as vehicle:
        found = [vehicle.parameter(name) for name in names] if names else list(vehicle.parameters().values())
    for value in found:
        typer.echo(f"{value.name},{value.value:.9g}")


@params.command("set")
def params_set(
    name: Annotated[str, typer.Argument(help="Name.")],
    value: Annotated[float, typer.Argument(help="Value.")],
    connect: Connect = DEFAULT_CONNECT,
    system: System = None,
    yes: Yes = False,
    ground: Ground = 255,
    key_file: KeyFile = None,
    record: Record = RECORDINGS,
) -> None:
    """Set a parameter and read it back.

    \b
    Examples:
      skyway params set RTL_ALT 6000 --yes --connect tcp:127.0.0.1:5760
    """  # noqa: D301
    with aboard(connect, system, Autopilot.AUTO, ground, key_file, record) as vehicle:
        before = vehicle.parameter(name)
        if yes:
            typer.echo(f"{name}: {before.value:.9g} -> {vehicle.set_parameter(name, value).value:.9g}")
        else:
            typer.echo(f"{name}: {before.value:.9g} -> {value:.9g} would be set; add --yes")


@params.command("diff")
def params_diff(
    file: Annotated[Path, typer.Argument(help="Parameter file with NAME,VALUE lines.")],
    connect: Connect = DEFAULT_CONNECT,
    system: System = None,
    ground: Ground = 255,
    key_file: KeyFile = None,
    record: Record = RECORDINGS,
) -> None:
    """Compare the vehicle with a parameter file; exit code 1 where it differs.

    \b
    Examples:
      skyway params diff delivery.param --connect tcp:127.0.0.1:5760
    """  # noqa: D301
    from link.parameter_file import read_parameters
    from link.parameters import same_value

    wanted = read_parameters(file)
    with aboard(connect, system, Autopilot.AUTO, ground, key_file, record) as vehicle:
        actual = vehicle.parameters()
    found = 0
    for name, value in wanted.items():
        has = actual.get(name)
        if has is None or not same_value(value, has.value, has.kind):
            found += 1
            typer.echo(f"{name}: file {value:.9g}, vehicle {'has none' if has is None else f'{has.value:.9g}'}")
    typer.echo(f"{found} of {len(wanted)} differ" if found else f"all {len(wanted)} are as the file says")
    if found:
        raise typer.Exit(1)
