"""Work distributed over processes of this machine, or over a Dask cluster: the same answers for any number and order of workers.

A piece of work is a call of a function of a module with one argument; it must not depend on anything else. Answers are returned in the order of
the arguments. Pieces of a lost worker are repeated.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections import deque
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, ProcessPoolExecutor, wait
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from skyway.models.base.errors import InputError, SkywayError
from skyway.models.compute.worker_processes import begin_worker, end_workers

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from concurrent.futures import Executor, Future

    Told = Callable[[int, int, float], None]

T = TypeVar("T")
R = TypeVar("R")
TRIES = 3
"""A piece whose worker was lost this often is abandoned: the piece itself probably ends them."""
AHEAD = 3
"""Bundles handed over at a time, for each worker."""
BUNDLE_S = 2.0
"""Target duration of a bundle of pieces, of a worker's time."""
MOST = 64
"""Pieces of a bundle."""
CONNECT_S = 10.0


def processors() -> int:
    """Processors that this process may use."""
    try:
        return max(len(os.sched_getaffinity(0)), 1)
    except AttributeError:  # not available on this system
        return os.cpu_count() or 1


def spread(
    work: Callable[[T], R] | Callable[[Any, T], R],
    arguments: Sequence[T],
    *,
    common: object = None,
    workers: int = 1,
    cluster: str | None = None,
    told: Told | None = None,
) -> list[R]:
    """Return what `work` returns for each argument, in their order.

    Parameters
    ----------
    work : callable
        A function of a module, that others can import.
    arguments : sequence
        Arguments of the pieces; they are pickled.
    common : object, optional
        Data common to all pieces, too large to be sent with each: it precedes the argument of `work`.
    workers : int
        Processes of this machine; with 1 it is done in this one.
    cluster : str, optional
        Scheduler of a Dask cluster, ``tcp://HOST:PORT``, in place of processes.
    told : callable, optional
        Called with pieces done, all pieces, and an estimate of the remaining time, s; NaN at first.

    Raises
    ------
    InputError
        The cluster cannot be reached, or its workers cannot do the work.
    SkywayError
        A piece has ended its workers `TRIES` times; or what the work itself raises.
    """
    progress = _Progress(len(arguments), told)
    if cluster is None and workers <= 1:
        found: list[R] = []
        for one in arguments:
            found += _bundle(work, common, [one])[0]
            progress.done(1)
        return found
    return _Spread(work, arguments, common, progress, workers, cluster).all()


class _Progress:
    """Progress, and an estimate of the remaining time at the current pace."""

    def __init__(self, total: int, told: Told | None) -> None:
        self._total, self._told, self._count = total, told, 0
        self._begin_s = time.monotonic()

    def done(self, pieces: int) -> None:
        self._count += pieces
        if self._told is not None:
            spent_s = time.monotonic() - self._begin_s
            self._told(self._count, self._total, spent_s * (self._total - self._count) / self._count)


class _Spread(Generic[T, R]):
    """One round of work."""

    def __init__(
        self,
        work: Callable[..., R],
        arguments: Sequence[T],
        common: object,
        progress: _Progress,
        workers: int,
        cluster: str | None,
    ) -> None:
        self._work, self._arguments, self._common, self._progress = work, arguments, common, progress
        self._workers, self._cluster = workers, cluster
        self._answers: dict[int, R] = {}
        self._lost = [0] * len(arguments)
        self._size = 1
        """Pieces of the next bundle; the number grows if they are short."""

    def all(self) -> list[R]:
        left = list(range(len(self._arguments)))
        while left:
            with self._executor() as (executor, workers, common):
                self._round(executor, common, deque(left), AHEAD * workers)
            left = [number for number in left if number not in self._answers]
        return [self._answers[number] for number in range(len(self._arguments))]

    def _round(self, executor: Executor, common: object, left: deque[int], ahead: int) -> None:
        """Do pieces until all are done, or the workers were lost."""
        running: dict[Future[tuple[list[R], float]], list[int]] = {}
        try:
            while left or running:
                while left and len(running) < ahead:
                    bundle = [left.popleft() for _ in range(min(self._size, len(left)))]
                    pieces = [self._arguments[one] for one in bundle]
                    running[executor.submit(_bundle, self._work, common, pieces)] = bundle
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    bundle = running[future]
                    answers, spent_s = future.result()
                    del running[future]
                    self._answers.update(zip(bundle, answers, strict=True))
                    pace_s = max(spent_s / len(bundle), 1e-6)
                    self._size = max(min(int(BUNDLE_S / pace_s), MOST, 2 * self._size), 1)
                    self._progress.done(len(bundle))
        except _lost_errors() as error:
            self._size = 1
            for bundle in running.values():
                for one in bundle:
                    self._lost[one] += len(bundle) == 1  # in a larger bundle the piece is unknown
            if max(self._lost) >= TRIES:
                raise SkywayError(f"workers were lost {TRIES} times at one piece of work: {error}") from error
        finally:
            for future in running:
                future.cancel()

    @contextmanager
    def _executor(self) -> Iterator[tuple[Executor, int, object]]:
        """Yield an executor, its number of workers, and a placeholder of the common data, which each worker is sent once."""
        if self._cluster is None:
            spawn = multiprocessing.get_context("spawn")
            pool = ProcessPoolExecutor(self._workers, mp_context=spawn, initializer=_keep, initargs=(self._common,))
            try:
                yield pool, self._workers, _Kept()
            except BaseException:
                end_workers(pool)
                raise
            pool.shutdown(wait=False, cancel_futures=True)
            return
        try:
            import distributed
        except ImportError as error:
            remedy = "pip install 'skyway-planner[cluster]'"
            raise InputError(
                "a cluster needs Dask, which is not installed", field="--cluster", remedy=remedy
            ) from error
        try:
            dask: Any = distributed  # its functions have no types
            client = dask.Client(self._cluster, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            remedy = "start one: dask scheduler, and: dask worker tcp://HOST:8786"
            raise InputError(
                "no Dask scheduler answers", field="--cluster", value=self._cluster, remedy=remedy
            ) from error
        with client:
            try:
                client.wait_for_workers(1, timeout=CONNECT_S)
            except TimeoutError as error:
                remedy = f"start some: dask worker {self._cluster}"
                raise InputError("has no workers", field="--cluster", value=self._cluster, remedy=remedy) from error
            common = None if self._common is None else client.scatter([self._common], broadcast=True, hash=False)[0]
            yield client.get_executor(pure=False), len(client.scheduler_info(n_workers=-1)["workers"]), common


class _Kept:
    """Placeholder of the data that a process stores."""


_kept: list[object] = [None]


def _keep(common: object) -> None:
    """Start a process, and store the common data."""
    begin_worker()
    _kept[0] = common


def _bundle(work: Callable[..., R], common: object, arguments: list[T]) -> tuple[list[R], float]:
    begin = time.perf_counter()
    common = _kept[0] if isinstance(common, _Kept) else common
    given = () if common is None else (common,)
    return [work(*given, one) for one in arguments], time.perf_counter() - begin


def _lost_errors() -> tuple[type[BaseException], ...]:
    """Errors that mean a lost worker, not a fault in the work."""
    import sys

    exceptions: list[type[BaseException]] = [BrokenExecutor, CancelledError]
    if "distributed" in sys.modules:
        from distributed import KilledWorker

        exceptions.append(KilledWorker)
    return tuple(exceptions)
