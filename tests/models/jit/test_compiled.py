"""Compiled kernels are never stale."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

CALLEE = "from skyway.models.jit.compiled import compiled\n\n@compiled\ndef inner(x):\n    return x + {}\n"
CALLER = "from callee import inner\nfrom skyway.models.jit.compiled import compiled\n\n@compiled\ndef outer(x):\n    return inner(x)\n"


HITS = "def hits(kernel): return sum(getattr(kernel, 'compiled', kernel).stats.cache_hits.values())\n"
"""How often a kernel was read from disk, beside a library of kernels or without."""


def _run(folder: Path, code: str = "", **environment: str) -> str:
    code = code or "from caller import outer; print(outer(1.0), hits(outer))"
    done = subprocess.run(
        [sys.executable, "-c", HITS + code],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | environment,
    )
    return done.stdout.strip()


def test_a_kernel_is_compiled_again_when_a_kernel_it_calls_in_another_file_changes(tmp_path):
    (tmp_path / "callee.py").write_text(CALLEE.format(1.0))
    (tmp_path / "caller.py").write_text(CALLER)
    assert _run(tmp_path) == "2.0 0"
    assert _run(tmp_path) == "2.0 1"
    (tmp_path / "callee.py").write_text(CALLEE.format(5.0))
    assert _run(tmp_path) == "6.0 0"


def test_a_kernel_read_from_disk_can_be_called_by_one_that_is_compiled_after_it_and_who_watches_is_told_of_that_one(
    tmp_path,
):
    (tmp_path / "callee.py").write_text(CALLEE.format(1.0))
    (tmp_path / "caller.py").write_text(CALLER)
    watched = "from skyway.models.jit import compiled; told = []; compiled.watchers.append(told.append); "
    assert _run(tmp_path, watched + "from callee import inner; print(inner(1.0), told)") == "2.0 ['inner', '']"
    loaded_first = "from caller import inner, outer; print(inner(1.0), *told, outer(2.0), *told, hits(inner))"
    assert _run(tmp_path, watched + loaded_first) == "2.0 3.0 outer  1"


@pytest.mark.slow
def test_a_kernel_is_compiled_again_when_a_constant_of_another_file_changes(tmp_path):
    (tmp_path / "constants.py").write_text("FACTOR = 2.0\n")
    (tmp_path / "callee.py").write_text(f"from constants import FACTOR\n{CALLEE.format('FACTOR')}")
    code = "from callee import inner; print(inner(1.0), hits(inner))"
    assert _run(tmp_path, code) == "3.0 0"
    assert _run(tmp_path, code) == "3.0 1"
    (tmp_path / "constants.py").write_text("FACTOR = 4.0\n")
    assert _run(tmp_path, code) == "5.0 0"


def test_a_kernel_in_a_folder_that_cannot_be_written_is_compiled_all_the_same(tmp_path):
    (tmp_path / "callee.py").write_text(CALLEE.format(1.0))
    code = "from callee import inner; print(inner(1.0))"
    (tmp_path / "__pycache__").write_text("no folder")
    assert _run(tmp_path, code, HOME="/dev/null", XDG_CACHE_HOME="/dev/null") == "2.0"


@pytest.mark.slow
def test_kernels_of_a_host_program_are_left_alone(tmp_path):
    """Its kernels, its cache and its numba are as they would be without skyway."""
    (tmp_path / "callee.py").write_text(CALLEE.format(1.0))
    (tmp_path / "host.py").write_text("import numba\n\n@numba.njit(cache=True)\ndef double(x):\n    return 2.0 * x\n")
    code = (
        "from numba.core import codegen; own = codegen.JITCPUCodegen._library_class\n"
        "from skyway.models.jit import compiled; told = []; compiled.watchers.append(told.append)\n"
        "from callee import inner; inner(1.0); from host import double; double(1.0)\n"
        "print(told, codegen.JITCPUCodegen._library_class is own, hits(double))"
    )
    assert _run(tmp_path, code) == "['inner', ''] True 0"
    assert _run(tmp_path, code) == "[] True 1"


def test_a_lean_kernel_that_makes_an_array_is_refused(tmp_path):
    lean = "import numpy\nfrom skyway.models.jit.compiled import compiled_lean\n\n@compiled_lean\ndef lean(n):\n    return numpy.zeros(n).sum()\n"
    (tmp_path / "lean.py").write_text(lean)
    done = subprocess.run(
        [sys.executable, "-c", "import lean; lean.lean(3)"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
    assert "numpy.zeros(n)" in done.stderr


BEYOND = """
import numpy
from skyway.models.jit.compiled import compiled_lean

@compiled_lean
def third(values):
    return values[2]
"""
READS_BEYOND = """
import numpy, sys
from beyond import third
try:
    third(numpy.zeros(4)[:2])
    print("not seen", end=" ")
except IndexError:
    print("seen", end=" ")
print(hits(third))
"""


@pytest.mark.slow
def test_a_run_that_checks_bounds_is_never_given_a_kernel_that_does_not_and_the_other_way_round(tmp_path):
    (tmp_path / "beyond.py").write_text(BEYOND)
    for hits in (0, 1):  # each kind is compiled once, then from disk
        assert _run(tmp_path, READS_BEYOND, NUMBA_BOUNDSCHECK="") == f"not seen {hits}"
        assert _run(tmp_path, READS_BEYOND, NUMBA_BOUNDSCHECK="1") == f"seen {hits}"
