"""Processes that work things out for the pages: the one that answers browsers never does."""

from __future__ import annotations

import asyncio
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import SkywayError
from skyway.web.work.calls import begin, call, prepare

if TYPE_CHECKING:
    from skyway.web.work.weather_and_zones import Given

PROCESSES = 2
"""One plans while the other reads files."""


class Workers:
    """A pool of processes; a call that kills its process is told, and the next one finds a new pool."""

    def __init__(self, given: Given) -> None:
        self._given = given
        self._pool: ProcessPoolExecutor | None = None

    def start(self, scenario: str | None) -> None:
        """Start a process, which loads what it will need."""
        self._opened().submit(prepare, scenario)

    def close(self) -> None:
        """End all processes, and what they are at."""
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
            for process in list((self._pool._processes or {}).values()):  # noqa: SLF001  there is no other way to end a call under way
                process.terminate()
            self._pool = None

    async def ask(self, name: str, *arguments: Any) -> Any:
        """Return what a function of `skyway.web.work` answers: ``module.function``; its `SkywayError` is raised here.

        Answers wait in line; a caller that is cancelled leaves it.
        """
        try:
            return _answer(await asyncio.wrap_future(self._opened().submit(call, name, arguments)))
        except BrokenProcessPool:
            self._pool = None
            raise SkywayError("the process that works things out has ended; ask again") from None

    def _opened(self) -> ProcessPoolExecutor:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                PROCESSES, mp_context=multiprocessing.get_context("spawn"), initializer=begin, initargs=(self._given,)
            )
        return self._pool


def _answer(found: Any) -> Any:
    if isinstance(found, SkywayError):
        raise found
    return found
