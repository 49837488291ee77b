"""Processes that compute for the pages, so that the process that answers browsers never does."""

from __future__ import annotations

import asyncio
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import SkywayError
from skyway.models.compute.worker_processes import end_workers
from skyway.web.work.calls import begin, call, prepare

if TYPE_CHECKING:
    from skyway.web.work.weather_and_zones import Given

AT_ONCE = 2
"""One plans while the other reads files."""
SPARE = 1
"""Spare process that has loaded its libraries, and replaces one whose work was cancelled."""


class Workers:
    """Processes, one call each at a time. A call that is no longer wanted is ended with its process, and one that kills its process fails."""

    def __init__(self, given: Given) -> None:
        self._given = given
        self._scenario: str | None = None
        self._turns = asyncio.Semaphore(AT_ONCE)
        self._idle: list[ProcessPoolExecutor] = []
        self._busy: set[ProcessPoolExecutor] = set()

    def start(self, scenario: str | None) -> None:
        """Start a process, which preloads its data; the spare one follows when that one has answered, so that the first page is not delayed."""
        self._scenario = scenario
        self._idle.append(self._prepared())

    def close(self) -> None:
        """End all processes, with their current work."""
        for process in (*self._idle, *self._busy):
            end_workers(process)
        self._idle, self._busy = [], set()

    async def ask(self, name: str, *arguments: Any) -> Any:
        """Return the result of a function of `skyway.web.work`: ``module.function``; its `SkywayError` is raised here.

        Calls wait in line. A cancelled call leaves it, or its process is ended, so that other calls do not wait for it.
        """
        async with self._turns:
            process = self._idle.pop() if self._idle else self._prepared()
            self._busy.add(process)
            done = False
            try:
                found = await asyncio.wrap_future(process.submit(call, name, arguments))
                done = True
            except BrokenProcessPool:
                raise SkywayError("the process that works things out has ended; ask again") from None
            finally:
                self._left(process, done=done)
        if isinstance(found, SkywayError):
            raise found
        return found

    def _left(self, process: ProcessPoolExecutor, *, done: bool) -> None:
        """Keep a process that has answered for the next call, end one that has not; a missing spare is replaced."""
        if process not in self._busy:
            return  # all have ended
        self._busy.remove(process)
        if done:
            self._idle.append(process)
        else:
            end_workers(process)
        while len(self._idle) + len(self._busy) < 1 + SPARE:
            self._idle.insert(0, self._prepared())

    def _prepared(self) -> ProcessPoolExecutor:
        """Start a process, which preloads its data."""
        process = ProcessPoolExecutor(
            1, mp_context=multiprocessing.get_context("spawn"), initializer=begin, initargs=(self._given,)
        )
        process.submit(prepare, self._scenario)
        return process
