"""Pictures of Python objects: ``skyway.plot``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError
from skyway.models.scenario.scenario import Scenario
from skyway.planner.result import PlanResult
from skyway.plots.charge_band import charge_band
from skyway.plots.map import plot_composition, plot_network
from skyway.plots.pictures import check_format

if TYPE_CHECKING:
    from os import PathLike

    from matplotlib.figure import Figure


def plot(what: PlanResult | Scenario, path: str | PathLike[str] | None = None) -> Figure:
    """Draw the answer of a planner (map, and charge over time), or the network of a scenario.

    Parameters
    ----------
    what : PlanResult or Scenario
        What to draw.
    path : path or None
        A ``.png``, ``.svg`` or ``.pdf`` to write as well; a file that is there is overwritten.

    Returns
    -------
    matplotlib.figure.Figure
        A notebook shows it.

    Raises
    ------
    InputError
        matplotlib is not installed, or the file cannot be written.
    """
    file = None if path is None else Path(path)
    if file is not None:
        check_format(file, "path")
    if isinstance(what, PlanResult):
        return plot_composition(what.composition, what.problem.scenario, file, charge_band(what))
    if isinstance(what, Scenario):
        return plot_network(what, file)
    raise InputError("cannot be drawn", field="what", value=type(what).__name__, remedy="a PlanResult or Scenario")
