"""A served page for tests: the command itself, in a process of its own."""

from __future__ import annotations

import contextlib
import http.client
import os
import re
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from skyway.flights.live import read_live

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).parents[2]


@dataclass
class Served:
    """A running page."""

    port: int
    folder: Path
    process: subprocess.Popen[str]

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def ask(
        self, path: str, method: str = "GET", body: bytes | None = None, **headers: str
    ) -> tuple[int, dict[str, str], str]:
        """Ask as no browser would: with any headers."""
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        with contextlib.closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)) as connection:
            connection.request(method, path, body=body, headers=named)
            with connection.getresponse() as answer:
                told = {name.lower(): value for name, value in answer.getheaders()}
                return answer.status, told, answer.read().decode("utf-8", "replace")

    def kill(self) -> None:
        """End it as nothing foresaw."""
        self.process.kill()
        self.process.wait()
        if self.process.stderr is not None:
            self.process.stderr.close()


def served(folder: Path, *options: str) -> Served:
    """Start the page on a free port."""
    pytest.importorskip("nicegui", reason="the page needs the extra web")
    command = [
        sys.executable,
        "-m",
        "skyway",
        "serve",
        *(() if "--port" in options else ("--port", "0")),
        *options,
        "--folder",
        str(folder),
    ]
    process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    line = process.stderr.readline()
    found = re.search(r":(\d+)\S* in a browser", line)
    if not found:
        process.kill()
        raise AssertionError(line + process.stderr.read())
    return Served(int(found[1]), folder, process)


def ended(page: Served) -> None:
    """End it as Ctrl-C does, and look whether it minded."""
    page.process.terminate()
    try:
        page.process.wait(20)
    finally:
        page.process.kill()
        if page.process.stderr is not None:
            page.process.stderr.close()


@pytest.fixture(scope="session")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """The page of the built-in scenario."""
    found = served(tmp_path_factory.mktemp("work"))
    yield found
    ended(found)


@pytest.fixture
def pages(tmp_path: Path) -> Iterator[list[Served]]:
    """The page that is served now, if any: at the end it is ended, and so is each flight that is still under way."""
    found: list[Served] = []
    yield found
    for one in found:
        ended(one)
    for live in tmp_path.glob("*.live"):
        told = read_live(live)
        if not told.ended:
            with contextlib.suppress(ProcessLookupError):
                os.kill(told.pid, signal.SIGKILL)


@pytest.fixture
def site(pages: list[Served], tmp_path: Path) -> Served:
    pages.append(served(tmp_path))
    return pages[0]
