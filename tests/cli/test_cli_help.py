"""What a person sees first: the commands in groups, completion in the shell, and what happens while kernels are compiled."""

import os
import subprocess
import sys

import pytest
import typer

from skyway.cli.command_groups import GROUPS
from skyway.cli.compiling import CompilingNotice
from skyway.cli.main import app, main
from skyway.cli.typed_words import RENAMED, with_new_names


def test_help_lists_every_command_under_a_heading_with_its_whole_first_sentence(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    known = set(typer.main.get_command(app).commands)
    assert {name for names in GROUPS.values() for name in names} == known
    for heading in GROUPS:
        assert f"\n{heading}:\n" in shown
    assert "..." not in shown.split("Plan:", 1)[1]


def test_help_of_a_group_shows_the_whole_first_sentence_of_its_commands(capsys):
    groups = [name for name, one in typer.main.get_command(app).commands.items() if hasattr(one, "commands")]
    assert len(groups) > 5
    for name in groups:
        assert main([name, "--help"]) == 0
        assert "..." not in capsys.readouterr().out.split("Commands:", 1)[1], name


@pytest.mark.parametrize(("columns", "most"), [("60", 60), ("80", 80), ("120", 120), ("200", 120)])
def test_help_uses_the_width_of_the_terminal(columns, most, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", columns)
    main(["--help"])
    widest = max(map(len, capsys.readouterr().out.splitlines()))
    assert 0.75 * most < widest <= most


@pytest.mark.parametrize(("typed", "expected"), [("skyway pl", "plan"), ("skyway plan --pla", "--planner")])
def test_the_shell_completes_commands_and_options(typed, expected):
    program = "import sys; sys.argv = ['skyway']; from skyway.cli.main import run; run()"
    asked = {"_SKYWAY_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(len(typed.split()) - 1)}
    environment = os.environ | asked | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert expected in done.stdout.split()


@pytest.mark.parametrize(("given", "used"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "4"}, "4")])
def test_the_command_line_runs_blas_in_one_thread_unless_told_otherwise(given, used):
    program = "import os, sys, skyway.cli; print(os.environ['OPENBLAS_NUM_THREADS'], 'numpy' in sys.modules)"
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    environment |= given | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == [used, "False"]  # read when numpy is imported, which is later


def test_help_needs_neither_numpy_nor_numba():
    program = "import sys; from skyway.cli.main import main; main(['plan', '--help']); print([one for one in ('numpy', 'numba') if one in sys.modules])"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_compiling_is_announced_once(capsys):
    notice = CompilingNotice()
    for kernel in ("first", "", "second", ""):
        notice(kernel)
    told = capsys.readouterr().err
    assert told.count("compiling its numerical kernels") == 1
    assert notice.count == 2


@pytest.mark.parametrize(("package", "extra"), [("fastcrc", "fly"), ("pymavlink.mavutil", "fly"), ("numba", "jit")])
def test_a_command_that_misses_a_package_names_the_extra_that_brings_it(package, extra, capsys, monkeypatch):
    def missing(*_, **__):
        raise ModuleNotFoundError(f"No module named {package!r}", name=package)

    monkeypatch.setattr("skyway.demo.run_demo", missing)
    assert main(["demo"]) == 2
    assert f"pip install 'skyway-planner[{extra}]'" in capsys.readouterr().err


def test_former_names_of_options_still_work(capsys):
    assert main(["wind", "--truth", "yesterday"]) == 2
    assert "--actual-wind: neither a date nor a file (got 'yesterday')" in capsys.readouterr().err
    assert with_new_names(["sim", "--for=5", "--", "--for"]) == ["sim", "--duration=5", "--", "--for"]


@pytest.mark.parametrize("command", RENAMED)
def test_a_former_name_of_an_option_is_shown_nowhere_and_leads_to_one_that_is(command):
    found = typer.main.get_command(app).commands[command]
    shown = {
        name for each in getattr(found, "commands", {"": found}).values() for one in each.params for name in one.opts
    }
    assert set(RENAMED[command].values()) <= shown
    assert shown.isdisjoint(RENAMED[command])
