"""A reader who types the documentation: every block in order in one folder, with a second terminal where a page asks for one.

The line before a block says how it is typed:

- nothing: in this terminal; each command ends with exit code 0.
- ``<!-- in another terminal -->``: it runs beside what follows, and is ended by Ctrl-C at the end of the page.
- ``<!-- until Ctrl-C -->``: it is ended by Ctrl-C as soon as all that it announces has happened.
- ``<!-- flight -->``: flies a delivery, or needs one that was flown, which takes minutes; typed only where flights are asked for.
- ``<!-- flight, answered with: yes -->``: the same; it asks, and is answered.
- ``<!-- flights, each in another terminal, answered with: yes -->``: the same, all of them at once.
- ``<!-- file: NAME -->``: no command; the reader saves it under that name.
- ``<!-- output -->``: what the command before it prints.
- ``<!-- not run: REASON -->``: cannot be typed anywhere; the files that it reads must be there all the same.

``<!-- after: PAGE -->`` at the head of a page: it goes on with the files of that page.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from typing import TYPE_CHECKING, Self

import yaml
from docs_pages import OUTPUT, ROOT, Block, arguments, blocks, run, shape

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

ANOTHER_TERMINAL = "<!-- in another terminal -->"
UNTIL_STOPPED = "<!-- until Ctrl-C -->"
FLIGHT = "<!-- flight -->"
ANSWERED_FLIGHT = "<!-- flight, answered with: yes -->"
ANSWERED_FLIGHTS = "<!-- flights, each in another terminal, answered with: yes -->"
DEADLINE_S = 180.0
"""For everything that is waited for: far more than it takes, since the machine may be busy."""
INTERRUPTED = 130
"""Exit code of a command that Ctrl-C broke off; those that Ctrl-C ends as usual exit with 0."""
_PORTS = ("5760", "5770", "5790", "5791", "14540", "14550", "8080")
_SECOND_VEHICLE = ("5780", "5770")
"""A simulator's second vehicle listens ten ports above its first."""
_FILE = re.compile(r"<!-- file: (\S+) -->")
_NOT_RUN = re.compile(r"<!-- not run: (.+) -->")
_AFTER = re.compile(r"<!-- after: (\S+) -->")
_INPUT = re.compile(r"[\w./-]+\.(?:json|jsonl|plan|waypoints|param|toml|tlog|csv|txt)")
_WRITTEN_BY = ("-o", "--output", "--plot", "--geojson", "--report", "--csv", "--journal", "--calibration-flight")

_AS_TYPED = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from skyway.cli.main import run; run()"
)
"""As from a terminal: Ctrl-C ends it, also where whoever runs the tests (a job in the background) does not listen to it."""


class _NavLoader(yaml.SafeLoader):
    """Reads mkdocs.yml, whose other entries may name Python objects."""


_NavLoader.add_multi_constructor("tag:yaml.org,2002:python/", lambda *_: None)


def reading_order() -> list[Path]:
    """README, then the pages in the order of the navigation."""
    nav = yaml.load((ROOT / "mkdocs.yml").read_text(), _NavLoader)["nav"]

    def leaves(entry: object) -> Iterator[str]:
        if isinstance(entry, str):
            yield entry
        elif isinstance(entry, dict):
            yield from (leaf for value in entry.values() for leaf in leaves(value))
        elif isinstance(entry, list):
            yield from (leaf for value in entry for leaf in leaves(value))

    return [ROOT / "README.md", *(ROOT / "docs" / leaf for leaf in leaves(nav))]


def pages_before(page: Path) -> list[Path]:
    """Pages whose files a page goes on with, and theirs, in the order of reading."""
    found: list[Path] = []
    for name in _AFTER.findall(page.read_text()):
        earlier = ROOT / "docs" / name
        found += [each for each in (*pages_before(earlier), earlier) if each not in found]
    return found


def reasons_not_run() -> list[tuple[Path, str]]:
    """Every block that nobody can type, with its reason."""
    found = [(page, _NOT_RUN.fullmatch(block.mark)) for page in reading_order() for block in blocks(page)]
    return [(page, match[1]) for page, match in found if match]


class Reader:
    """Types pages into one folder.

    Parameters
    ----------
    folder : Path
        Empty at first.
    flights : bool
        Whether to fly, too.
    compares : bool
        Whether what is printed must have the shape that the page shows.
    """

    def __init__(self, folder: Path, *, flights: bool = False, compares: bool = True) -> None:
        self.folder, self.flights, self.compares = folder, flights, compares
        self._ports = dict(zip(_PORTS, _free_ports(len(_PORTS)), strict=True))
        second, first = _SECOND_VEHICLE
        self._ports[second] = str(int(self._ports[first]) + 10)

    def type_page(self, page: Path) -> list[tuple[Block, str]]:
        """Type a page; returns what came out before each block of output."""
        names: dict[str, object] = {}
        shown: list[tuple[Block, str]] = []
        last = ""
        with contextlib.ExitStack() as terminals:
            for block in blocks(page):
                where = f"{page.relative_to(ROOT)}: "
                if block.mark == OUTPUT:
                    shown.append((block, last))
                    if self.compares:
                        assert shape(last) == shape(block.text), f"{where}{last}\nrun: python tests/cli/docs_pages.py"
                elif match := _FILE.fullmatch(block.mark):
                    (self.folder / match[1]).write_text(block.text)
                elif _NOT_RUN.fullmatch(block.mark):
                    for command in block.typed:
                        self._has_inputs(command, where)
                elif block.language == "python":
                    exec(compile(block.text, str(page), "exec"), names)
                else:
                    last = self._type_block(block, terminals, where) or last
        return shown

    def _type_block(self, block: Block, terminals: contextlib.ExitStack, where: str) -> str:
        """Type the commands of a block as its mark says; returns what the last of them printed."""
        last = ""
        if block.mark == ANSWERED_FLIGHTS:
            return self._fly(*map(self._with_free_ports, block.typed), where=where) if self.flights else last
        for written in block.typed:
            command = self._with_free_ports(written)
            if block.mark == ANOTHER_TERMINAL:
                terminals.enter_context(Terminal(command, where))
            elif block.mark == UNTIL_STOPPED:
                with Terminal(command, where) as terminal:
                    terminal.wait_for_faults()
            elif block.mark == ANSWERED_FLIGHT:
                last = self._fly(command, where=where) if self.flights else last
            elif block.mark == FLIGHT and not self.flights:
                continue
            else:
                code, last, err = run(command)
                assert code == 0, f"{where}{command}: exit {code}: {err}\n{last}"
                assert_faults_happened(command, last.splitlines())
        return last

    def _fly(self, *commands: str, where: str) -> str:
        """Fly, all at once; returns what the last of them printed."""
        with contextlib.ExitStack() as open_terminals:
            terminals = [open_terminals.enter_context(Terminal(each, where, ready=False)) for each in commands]
            for terminal in terminals:
                terminal.wait_for("yes or no?")
                terminal.answer("yes")
            for terminal in terminals:
                terminal.ends(4 * DEADLINE_S)
        return "\n".join(terminals[-1].lines)

    def type_faulty_flight(self, page: Path, fault: str) -> None:
        """Type the plan, the simulator with one fault more, and the flight of a page, until the fault has happened."""
        where = f"{page.relative_to(ROOT)}: {fault}: "
        with contextlib.ExitStack() as terminals:
            for block in blocks(page):
                if block.mark == ANOTHER_TERMINAL:
                    command = self._with_free_ports(block.typed[0]) + f" --fault {fault}"
                    simulator = terminals.enter_context(Terminal(command, where))
                elif block.mark == ANSWERED_FLIGHT:
                    with Terminal(self._with_free_ports(block.typed[0]), where, ready=False) as flight:
                        flight.wait_for("yes or no?")
                        flight.answer("yes")
                        simulator.wait_for("in the air")
                        simulator.wait_for_faults()
                        flight.stop()
                    return
                elif not _NOT_RUN.fullmatch(block.mark):
                    self._type_block(block, terminals, where)

    def _has_inputs(self, command: str, where: str) -> None:
        """A command that cannot be run here still reads files that the reader has by then."""
        words = arguments(command)
        for before, word in itertools.pairwise(words):
            if _INPUT.fullmatch(word) and before not in _WRITTEN_BY:
                assert (self.folder / word).exists(), f"{where}{command}: nothing made {word}"

    def _with_free_ports(self, command: str) -> str:
        """The ports of the page, each replaced by a free one: tests run side by side."""
        return re.sub(r"\b(" + "|".join(self._ports) + r")\b", lambda match: self._ports[match[1]], command)


class Terminal:
    """A command in a terminal of its own, until it ends or Ctrl-C."""

    def __init__(self, command: str, where: str, *, ready: bool = True) -> None:
        self.command, self.where = command, where
        self.lines: list[str] = []
        self._ready, self._stopped = ready, False
        self._process: subprocess.Popen[str]
        self._reading: threading.Thread

    def __enter__(self) -> Self:
        environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
        self._process = subprocess.Popen(
            [sys.executable, "-c", _AS_TYPED, *arguments(self.command)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=environment,
        )
        self._reading = threading.Thread(target=self._read, daemon=True)
        self._reading.start()
        if self._ready:
            try:
                self.wait_for("")
            except AssertionError:
                self._kill()
                raise
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None or self._stopped:
            self._kill()
            return
        interrupted = self._process.poll() is None
        if interrupted:
            self._process.send_signal(signal.SIGINT)
        self.ends(DEADLINE_S, codes=(0, INTERRUPTED) if interrupted else (0,))
        assert_faults_happened(self.command, self.lines)

    def ends(self, deadline_s: float, *, codes: tuple[int, ...] = (0,)) -> None:
        """Wait for its end, which must be a clean one."""
        try:
            code = self._process.wait(deadline_s)
        except subprocess.TimeoutExpired:
            self._kill()
            raise AssertionError(self._told("does not end")) from None
        self._close()
        assert code in codes, self._told(f"exit {code}")
        assert not any("Traceback" in line for line in self.lines), self._told("a traceback")

    def answer(self, text: str) -> None:
        """Type a line into it."""
        assert self._process.stdin is not None
        self._process.stdin.write(text + "\n")
        self._process.stdin.flush()

    def wait_for(self, text: str) -> None:
        """Wait for a line that holds a text."""
        until = time.monotonic() + DEADLINE_S
        while not any(text in line for line in self.lines):
            assert self._reading.is_alive(), self._told(f"ended before it said {text!r}")
            assert time.monotonic() < until, self._told(f"never said {text!r}")
            time.sleep(0.02)

    def wait_for_faults(self) -> None:
        """Wait until every fault that the command announces has begun."""
        for text, _ in announced(self.command):
            self.wait_for(text)

    def stop(self) -> None:
        """End it at once, as ``kill -9`` does."""
        self._stopped = True
        self._kill()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.lines.append(line.rstrip("\n"))

    def _kill(self) -> None:
        self._process.kill()
        self._process.wait()
        self._close()

    def _close(self) -> None:
        """Read what is left and close both pipes, once it has ended."""
        self._reading.join(DEADLINE_S)
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()

    def _told(self, what: str) -> str:
        return "\n".join([f"{self.where}{self.command}: {what}", *self.lines[-30:]])


def announced(command: str) -> list[tuple[str, bool]]:
    """What the simulator says when each fault of a command begins, and whether it counts from the take-off."""
    found = []
    for word in re.findall(r"--fault[ =](\S+)", command):
        kind = re.split(r"[=@+#]", word)[0]
        found.append(("are taken" if kind == "pads-taken" else f"fault {kind} begins", "@T+" in word))
    return found


def assert_faults_happened(command: str, lines: list[str]) -> None:
    """Every fault that a command announces has begun, after the take-off where it counts from there."""
    for text, in_flight in announced(command):
        begun = [number for number, line in enumerate(lines) if text in line]
        assert begun, f"{command}: never said {text!r}"
        if in_flight:
            assert any("in the air" in line for line in lines[: begun[0]]), f"{command}: {text!r} before the take-off"


def _free_ports(count: int) -> list[str]:
    """Ports that nobody listens on, UDP nor TCP."""
    with contextlib.ExitStack() as held:
        found = []
        for _ in range(count):
            taken = held.enter_context(socket.socket())
            taken.bind(("127.0.0.1", 0))
            found.append(str(taken.getsockname()[1]))
        return found
