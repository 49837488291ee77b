"""Worker processes: they leave Ctrl-C to their parent, and end when it does."""

from __future__ import annotations

import multiprocessing
import os
import signal
import socket
import threading
from contextlib import contextmanager, suppress
from multiprocessing.connection import wait
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from concurrent.futures import ProcessPoolExecutor

LIFELINE = "SKYWAY_LIFELINE"
"""Variable of the environment with the port that is open as long as a program that others are to end with."""
_HOST, _BACKLOG = "127.0.0.1", 512


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
    """End the processes of a pool at once, even in the middle of a job."""
    started = list((pool._processes or {}).values())  # noqa: SLF001  there is no other way to end a call under way
    pool.shutdown(wait=False, cancel_futures=True)
    for process in started:
        process.kill()


@contextmanager
def lifeline() -> Iterator[dict[str, str]]:
    """Give the environment of commands that are to end with this program, and so are those that they start, however it ends.

    They call `hold_lifeline`. Nobody answers them: the system ends their connections with the program that they lead to.
    """
    with socket.create_server((_HOST, 0), backlog=_BACKLOG) as listener:
        yield {**os.environ, LIFELINE: str(listener.getsockname()[1])}


def hold_lifeline() -> None:
    """End this process with the program whose `lifeline` is in its environment, where there is one."""
    port = os.environ.get(LIFELINE)
    if port is None:
        return
    try:
        held = socket.create_connection((_HOST, int(port)))
    except OSError:  # it has ended already
        os._exit(1)
    threading.Thread(target=_end_with_connection, args=(held,), daemon=True).start()


def _end_with_connection(held: socket.socket) -> None:
    with suppress(OSError):
        held.recv(1)
    os._exit(1)
