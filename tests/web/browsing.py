"""Debian's Chromium, headless, and tabs of it that notice what they should not ask for and what goes wrong in them."""

from __future__ import annotations

import os
import shutil
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync",
]  # fmt: skip
PATIENT_MS = 1000 * int(os.environ.get("SKYWAY_PATIENT_S", "120"))
"""So long anything may take that is waited for; more where other programs keep the machine busy."""
FLIGHT_MS = 600_000
"""A simulated flight takes no longer, on a busy machine either."""
AXE = os.environ.get("SKYWAY_AXE", "node_modules/axe-core/axe.min.js")
"""axe-core of the npm registry: `npm install axe-core`; without it accessibility is not judged."""
HELD_MS = 1_500
WIDER = """() => [document.documentElement, ...document.querySelectorAll('.panel')]
    .filter((one) => one.scrollWidth > one.clientWidth).map((one) => `${one.className}: ${one.scrollWidth} px in ${one.clientWidth} px`)"""
"""The page, or its panels, that one must scroll to the side to see."""


def installed() -> str:
    """Return the browser that is installed; skip where there is none."""
    found = next(
        (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
    )
    return found or pytest.skip("no Chromium is installed: apt-get install chromium")


@contextmanager
def chromium() -> Iterator[Any]:
    """Start the browser."""
    api = pytest.importorskip("playwright.sync_api", reason="needs the package playwright")
    found = installed()
    with api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=found, args=FLAGS)
        yield browser
        browser.close()


@contextmanager
def person(
    browser: Any, address: str, path: str, *, minds: bool = True, also: str | None = None, **how: Any
) -> Iterator[Any]:
    """Open a page as a person of their own; nothing may be asked of another host, but `also`, and nothing go wrong in the console, if that is minded."""
    context = browser.new_context(**({"viewport": {"width": 1280, "height": 900}} | how))
    context.set_default_timeout(PATIENT_MS)
    tab = context.new_page()
    wrong: list[str] = []
    elsewhere: list[str] = []
    tab.on("console", lambda message: wrong.append(message.text) if message.type in {"error", "warning"} else None)
    tab.on("pageerror", lambda error: wrong.append(str(error)))
    fine = (address, "blob:", "data:", *([] if also is None else [also]))
    tab.on("request", lambda one: None if one.url.startswith(fine) else elsewhere.append(one.url))
    tab.goto(address + path)
    tab.wait_for_selector("#main *")
    yield tab
    context.close()
    assert elsewhere == []
    if minds:
        assert wrong == []


def hold(tab: Any, words: str) -> None:
    """Hold a button down for as long as it wants."""
    button = tab.get_by_role("button", name=words).first
    button.wait_for()
    button.scroll_into_view_if_needed()
    box = button.bounding_box()
    tab.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    tab.mouse.down()
    tab.wait_for_timeout(HELD_MS)
    tab.mouse.up()


def state(tab: Any, *wanted: str) -> None:
    """Wait until the flight that is open is in one of some states."""
    tab.wait_for_function(
        "(wanted) => wanted.includes(document.querySelector('.flight .state')?.textContent)",
        arg=list(wanted),
        timeout=FLIGHT_MS,
    )
