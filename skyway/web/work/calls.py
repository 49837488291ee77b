"""Calls into this room from another process."""

from __future__ import annotations

import signal
from importlib import import_module
from typing import Any

from skyway.models.base.errors import SkywayError


def prepare(scenario: str | None) -> None:
    """Load what planning needs, before anybody waits for it."""
    from skyway.web.work.region import loaded

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the server, which ends this

    try:
        loaded(scenario)
    except SkywayError:
        return  # who asks for it is told


def call(name: str, arguments: tuple[Any, ...]) -> Any:
    """Return what ``module.function`` of this room answers; a `SkywayError` as a value, since not all can be sent as errors."""
    module, _, function = name.partition(".")
    try:
        return getattr(import_module(f"skyway.web.work.{module}"), function)(*arguments)
    except SkywayError as error:
        return SkywayError(str(error))
