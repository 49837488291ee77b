"""Calls into this room from another process."""

from __future__ import annotations

import traceback
from importlib import import_module
from typing import Any

from skyway.models.base.errors import SkywayError
from skyway.models.compute.worker_processes import begin_worker
from skyway.web.work.weather_and_zones import Given, give


def begin(what: Given) -> None:
    """Begin a process: it knows what the page was started with, and leaves Ctrl-C to the server, which ends it. It ends with the server, too."""
    begin_worker()
    give(what)


def prepare(scenario: str | None) -> None:
    """Load what the map and planning need, before anybody waits for it."""
    from skyway.web.work.region import region

    try:
        region(scenario)
        import_module("skyway.web.work.planned")
    except SkywayError:
        return  # who asks for it is told


def call(name: str, arguments: tuple[Any, ...]) -> Any:
    """Return what ``module.function`` of this room answers; a `SkywayError` as a value, since not all can be sent as errors.

    What nobody foresaw is told so, too: one file that does so takes nothing else with it.
    """
    module, _, function = name.partition(".")
    try:
        return getattr(import_module(f"skyway.web.work.{module}"), function)(*arguments)
    except SkywayError as error:
        return SkywayError(str(error))
    except Exception as error:  # noqa: BLE001  whatever a file of others brings about
        traceback.print_exc()
        return SkywayError(f"an error of skyway itself: {error!r}"[:500])
