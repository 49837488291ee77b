"""Calls into this room from another process."""

from __future__ import annotations

import traceback
from importlib import import_module
from typing import Any

from skyway.models.base.errors import SkywayError
from skyway.models.compute.worker_processes import begin_worker
from skyway.web.work.weather_and_zones import Given, give


def begin(what: Given) -> None:
    """Start a process: it gets the options of the page, and leaves Ctrl-C to the server, which ends it. It ends with the server, too."""
    begin_worker()
    give(what)


def prepare(scenario: str | None) -> None:
    """Load the data of the map and of planning before the first request."""
    from skyway.web.work.region import region

    try:
        region(scenario)
        import_module("skyway.web.work.planned")
    except SkywayError:
        return  # the request that needs it reports the error


def call(name: str, arguments: tuple[Any, ...]) -> Any:
    """Return the result of ``module.function`` of this room; a `SkywayError` as a value, since not all can be sent as errors.

    Unexpected errors are returned, too: a file that causes one does not affect anything else.
    """
    module, _, function = name.partition(".")
    try:
        return getattr(import_module(f"skyway.web.work.{module}"), function)(*arguments)
    except SkywayError as error:
        return SkywayError(str(error))
    except Exception as error:  # noqa: BLE001  whatever a file of others brings about
        traceback.print_exc()
        return SkywayError(f"an error of skyway itself: {error!r}"[:500])
