"""Processes that work for another one: they leave Ctrl-C to it, and end when it does."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from multiprocessing.connection import wait
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor


def begin_worker() -> None:
    """Begin a process that works for its parent: it ends with it, also where that was killed and could not say so."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)


def end_workers(pool: ProcessPoolExecutor) -> None:
    """End the processes of a pool at once, whatever they are at."""
    started = list((pool._processes or {}).values())  # noqa: SLF001  there is no other way to end a call under way
    pool.shutdown(wait=False, cancel_futures=True)
    for process in started:
        process.kill()
