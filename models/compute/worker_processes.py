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
"""Environment variable with a port that is open as long as the program with which child processes are to end."""
ENDS_S = 10.0
"""How long the end of killed processes is waited for."""
_HOST, _BACKLOG = "127.0.0.1", 512


def begin_worker() -> None:
    """Start a worker process that ends with its parent, also if the parent was killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)


def end_workers(pool: ProcessPoolExecutor) -> None:
    """End the processes of a pool at once, even in the middle of a job, and its thread with them.

    A thread that is still closing its pipes when the program ends makes the interpreter print a traceback.
    """
    started = list((pool._processes or {}).values())  # noqa: SLF001  there is no other way to end a call under way
    # `shutdown` forgets the thread; typeshed has another type for it.
    manager: threading.Thread | None = pool._executor_manager_thread  # type: ignore[assignment]  # noqa: SLF001
    pool.shutdown(wait=False, cancel_futures=True)
    for process in started:
        process.kill()
    if manager is not None:
        manager.join(ENDS_S)


@contextmanager
def lifeline() -> Iterator[dict[str, str]]:
    """Return the environment of commands that are to end with this program, with the commands that they start, however it ends.

    They call `hold_lifeline`. The port never answers: the system closes the connections when the program ends.
    """
    with socket.create_server((_HOST, 0), backlog=_BACKLOG) as listener:
        yield {**os.environ, LIFELINE: str(listener.getsockname()[1])}


def hold_lifeline() -> None:
    """End this process with the program whose `lifeline` is in its environment, if there is one."""
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
