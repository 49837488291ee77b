"""Worker processes that are ended."""

import multiprocessing
import threading
import time
from concurrent.futures import ProcessPoolExecutor

from skyway.models.compute.worker_processes import end_workers


def test_nothing_of_a_pool_is_left_when_it_has_been_ended_in_the_middle_of_a_call():
    """What still runs when the program ends would print a traceback after Ctrl-C."""
    before = set(threading.enumerate())
    pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"))
    call = pool.submit(time.sleep, 3600.0)
    processes = list(pool._processes.values())
    end_workers(pool)
    assert set(threading.enumerate()) <= before
    assert call.done()
    for process in processes:
        process.join(10.0)
        assert process.exitcode is not None
