"""Running the command line as a person does, without starting a process."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import pytest

from skyway.cli.main import main


@pytest.fixture(scope="session", autouse=True)
def read_new_york_once():
    """Keep the built-in scenario between commands; one test reads it in a process of its own."""
    from skyway.missions.examples import NEW_YORK
    from skyway.models.scenario import file as scenario_file

    read = scenario_file.read_scenario
    kept = cache(read)
    patch = pytest.MonkeyPatch()
    patch.setattr(scenario_file, "read_scenario", lambda path: (kept if path == NEW_YORK else read)(path))
    yield
    patch.undo()


@dataclass(frozen=True)
class Answer:
    """What a command left behind."""

    code: int
    out: str
    err: str


@pytest.fixture
def skyway(capsys, tmp_path, monkeypatch):
    """Run ``skyway`` with arguments in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments) -> Answer:
        capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        found = capsys.readouterr()
        return Answer(code, found.out, found.err)

    return run


@pytest.fixture
def refused(skyway, tmp_path):
    """Run what must be refused: one line on stderr, nothing on stdout, no file; returns the line."""

    def run(*arguments, code: int = 2) -> str:
        before = sorted(tmp_path.rglob("*"))
        answer = skyway(*arguments)
        assert answer.code == code, answer
        assert answer.out == ""
        lines = answer.err.splitlines()
        assert len(lines) == 1, answer.err
        assert lines[0].startswith("skyway: ")
        assert "Traceback" not in answer.err
        assert sorted(tmp_path.rglob("*")) == before
        return lines[0]

    return run
