"""Draws the pictures of the page for README and documentation: ``python -m tests.web.pictures``. It needs Chromium, playwright and Pillow."""

from __future__ import annotations

import io
import os
import signal
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PIL import Image

from skyway.flights.live import read_live
from tests.web.browsing import chromium, person, state
from tests.web.conftest import ROOT, ended, served

if TYPE_CHECKING:
    from tests.web.conftest import Served

ASSETS = ROOT / "docs" / "assets"
QUESTION = "/?start=siuh-north&to=white-plains&depart=2013-07-10T14%3A00-04%3A00"
UNDER_WAY_MS = 20_000
SIZE = {"width": 1500, "height": 900}
COLOURS = 192
"""Of a picture, the most common ones, as they are: enough for the page, and a third of the bytes."""


def kept(tab: Any, name: str) -> None:
    """Take a picture, with few colours, so that it is small."""
    path = ASSETS / name
    picture = Image.open(io.BytesIO(tab.screenshot())).convert("RGB")
    common = sorted(picture.getcolors(maxcolors=2**24), reverse=True)[:COLOURS]
    palette = Image.new("P", (1, 1))
    palette.putpalette([value for _, colour in common for value in colour])
    picture.quantize(palette=palette, dither=Image.Dither.NONE).save(path, optimize=True)
    sys.stdout.write(f"{path.relative_to(ROOT)}: {path.stat().st_size // 1024} KiB\n")


def planned(browser: Any, page: Served) -> None:
    """A plan, with its reasons."""
    with person(browser, page.address, QUESTION, viewport=SIZE) as tab:
        tab.wait_for_selector(".reasons p")
        tab.wait_for_function("document.querySelector('.answer .status').textContent === ''")
        tab.wait_for_function("window.skywayMap.state.wind && window.skywayMap.state.queues")
        tab.wait_for_timeout(500)
        kept(tab, "page.png")


def flown(browser: Any, page: Served) -> None:
    """The demonstration on its first leg, commanded."""
    with person(browser, page.address, "/fly", viewport=SIZE) as tab:
        tab.get_by_role("tab").nth(1).click()
        state(tab, "flying")
        tab.get_by_role("button", name="Take command").click()
        tab.wait_for_timeout(UNDER_WAY_MS)
        kept(tab, "page-fly.png")


def main() -> None:
    """Take both."""
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        page = served(Path(folder), "--demo")
        try:
            planned(browser, page)
            flown(browser, page)
        finally:
            ended(page)
            for live in Path(folder).glob("*.live"):
                os.kill(read_live(live).pid, signal.SIGKILL)


if __name__ == "__main__":
    main()
