"""What is worked out for a page ends when nobody wants it any more, and no earlier answer comes after a later one."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from skyway.models.base.errors import SkywayError
from skyway.web.server import RECONNECT_S
from skyway.web.work.weather_and_zones import Given
from skyway.web.workers import AT_ONCE, Workers
from tests.web.browsing import chromium, person

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.slow

WAIT_S = 60.0
SLOW = "/?start=siuh-north&to=white-plains&depart=2013-07-10T14%3A00-04%3A00&window=12h"
"""Departures of twelve hours are tried: long enough to be cancelled."""


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    with chromium() as found:
        yield found


async def reader_of(pipe: Path) -> int:
    """Wait until a process reads from a pipe, which has nothing to read; return the other end."""
    until = time.monotonic() + WAIT_S
    while time.monotonic() < until:
        try:
            return os.open(pipe, os.O_WRONLY | os.O_NONBLOCK)
        except OSError:
            await asyncio.sleep(0.02)
    raise AssertionError("nobody reads")


async def left(end: int) -> bool:
    """Whether the reader goes, within the time."""
    until = time.monotonic() + WAIT_S
    while time.monotonic() < until:
        try:
            os.write(end, b" ")
        except BrokenPipeError:
            return True
        await asyncio.sleep(0.02)
    return False


def test_a_call_that_is_cancelled_ends_at_once_and_keeps_nobody_waiting(tmp_path):
    pipes = [tmp_path / f"{number}.json" for number in range(AT_ONCE + 1)]
    for pipe in pipes:
        os.mkfifo(pipe)

    async def cancelled() -> None:
        workers = Workers(Given())
        try:
            asked = [asyncio.create_task(workers.ask("exports.opened", str(pipe))) for pipe in pipes[:-1]]
            ends = [await reader_of(pipe) for pipe in pipes[:-1]]
            in_line = asyncio.create_task(workers.ask("exports.opened", str(pipes[-1])))
            asked[0].cancel()
            assert await left(ends[0])
            with pytest.raises(asyncio.CancelledError):
                await asked[0]
            ends.append(await reader_of(pipes[-1]))  # whoever stood in line has the turn
            in_line.cancel()
            with pytest.raises(SkywayError, match="no such file"):
                await workers.ask("exports.opened", str(tmp_path / "nothing.json"))
            assert not asked[1].done()
        finally:
            workers.close()
        assert await left(ends[1])
        with pytest.raises(SkywayError, match="has ended"):
            await asked[1]
        for end in ends:
            os.close(end)

    asyncio.run(cancelled())


def test_a_plan_under_way_gives_way_to_a_change_and_to_cancel(browser, page):
    with person(browser, page.address, SLOW) as tab:
        cancel = tab.get_by_role("button", name="Cancel")
        cancel.wait_for()
        tab.get_by_label("Leave within").fill("")
        tab.get_by_label("Leave within").press("Enter")
        tab.wait_for_selector("dl.figures")
        tab.wait_for_selector(".reasons p")
        cancel.wait_for(state="detached")
        assert tab.locator("h2", has_text="Departures tried").count() == 0  # of the answer that nobody wants
        before = tab.inner_text("dl.figures")

        tab.get_by_label("Leave within").fill("12h")
        tab.get_by_label("Leave within").press("Enter")
        tab.wait_for_selector(".old")
        cancel.click()
        tab.get_by_text("Cancelled. Below is the plan of the previous request.").wait_for()
        tab.locator("details.files summary").click()
        tab.get_by_role("button", name="Save in the work folder").click()
        tab.get_by_text("the plan is not ready yet").wait_for()
        tab.get_by_role("button", name="Plan now").click()
        cancel.wait_for()
        tab.get_by_role("button", name="Undo").click()
        tab.wait_for_function(
            "!document.querySelector('.old') && document.querySelector('.answer .status').textContent === ''"
        )
        assert tab.inner_text("dl.figures") == before
        assert tab.locator("h2", has_text="Departures tried").count() == 0


def test_escape_cancels_what_is_under_way(browser, page):
    with person(browser, page.address, SLOW) as tab:
        tab.get_by_role("button", name="Cancel").wait_for()
        tab.keyboard.press("Escape")
        tab.get_by_role("button", name="Plan now").wait_for()


def test_a_page_that_is_closed_ends_what_it_asked_for(browser, page):
    with person(browser, page.address, SLOW) as tab:
        tab.get_by_role("button", name="Cancel").wait_for()
        workers = children(page.process.pid)
        for one in workers:
            os.kill(one, signal.SIGSTOP)  # else the plan may be ready before the page is given up
    until = time.monotonic() + RECONNECT_S + WAIT_S
    while workers <= children(page.process.pid) and time.monotonic() < until:
        time.sleep(0.2)
    left = workers & children(page.process.pid)
    for one in left:
        os.kill(one, signal.SIGCONT)
    assert len(workers - left) == 1


def children(pid: int) -> set[int]:
    """Processes that one has started."""
    return {int(one) for one in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()}
