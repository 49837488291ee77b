"""Calls into this room from another process."""

from __future__ import annotations

import signal
from importlib import import_module
from typing import Any

from skyway.models.base.errors import SkywayError
from skyway.web.work.weather_and_zones import Given, give


def begin(what: Given) -> None:
    """Begin a process: it knows what the page was started with, and leaves Ctrl-C to the server, which ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
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
    """Return what ``module.function`` of this room answers; a `SkywayError` as a value, since not all can be sent as errors."""
    module, _, function = name.partition(".")
    try:
        return getattr(import_module(f"skyway.web.work.{module}"), function)(*arguments)
    except SkywayError as error:
        return SkywayError(str(error))
