"""Draws the picture of a flight on the page for the documentation: ``python -m tests.web.pictures``. It needs Chromium and playwright."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from pathlib import Path

from skyway.flights.live import read_live
from tests.web.browsing import chromium, person, state
from tests.web.conftest import ROOT, ended, served

PICTURE = ROOT / "docs" / "assets" / "page-fly.png"
UNDER_WAY_MS = 20_000
SIZE = {"width": 1500, "height": 900}


def main() -> None:
    """Fly the demonstration, and take its picture on the first leg."""
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        page = served(Path(folder), "--demo")
        try:
            with person(browser, page.address, "/fly", viewport=SIZE) as tab:
                tab.get_by_role("tab").nth(1).click()
                state(tab, "flying")
                tab.get_by_role("button", name="Take command").click()
                tab.wait_for_timeout(UNDER_WAY_MS)
                tab.screenshot(path=str(PICTURE))
        finally:
            ended(page)
            for live in Path(folder).glob("*.live"):
                os.kill(read_live(live).pid, signal.SIGKILL)
    sys.stdout.write(f"{PICTURE.relative_to(ROOT)}: {PICTURE.stat().st_size // 1024} KiB\n")


if __name__ == "__main__":
    main()
