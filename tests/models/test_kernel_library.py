"""Kernels compiled ahead of time give what numba gives; the list of them fits the source."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

import build_kernels
from skyway.models import kernel_library
from skyway.models.kernel_library import kind_of

ROOT = Path(__file__).parents[2]
KERNELS = """
import numpy
from typing import NamedTuple
from skyway.models.compiled import compiled

class Pair(NamedTuple):
    values: numpy.ndarray
    factor: float

@compiled
def scaled(pair, offset):
    return pair.values * pair.factor + offset

@compiled
def count(flags):
    total = 0
    for flag in flags:
        total += flag
    return total
"""


def test_every_listed_kernel_is_in_the_source_and_called_from_python():
    assert set(kernel_library.listed()) <= build_kernels.entries()


COMMANDS = """
import sys; sys.path.insert(0, r'{root}')
import build_kernels, contextlib, io, json
from skyway.cli.main import main
trip = ["--from", "bellevue", "--to", "jacobi", "--payload", "0.8", "--depart", "2013-07-10T14:00-04:00", "--drone", "m200"]
with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
    codes = [main(["plan", *trip, "--planner", name]) for name in ("robust", "pfs", "pfs-charge-aware", "shortest", "exact", "ies")]
    codes.append(main(["plan", *trip, "--wind", "9@200", "--objective", "p95"]))
listed = json.loads(build_kernels.LIST.read_text())
called = build_kernels.observed()
print(codes, [name for name, kinds in called.items() if any(kind not in listed.get(name, []) for kind in kinds)])
"""


def test_every_kernel_that_planning_calls_is_listed_for_the_types_it_is_called_with():
    done = subprocess.run(
        [sys.executable, "-c", COMMANDS.format(root=ROOT)], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[0, 0, 0, 0, 0, 0, 0] []", "run: make kernels"


def test_types_are_told_apart_as_numba_does():
    from numba import typeof

    values = np.arange(6.0).reshape(2, 3)
    frozen = values.copy()
    frozen.setflags(write=False)
    samples = [1, 1.5, True, None, np.float32(1), np.int64(3), values, values.T, values[:, ::2], frozen, values > 1]
    samples += [(1, 2.0), (values, (1, 2)), np.arange(3, dtype=np.uint8)]
    for sample in samples:
        assert json.loads(json.dumps(kind_of(sample))) == build_kernels._kind(typeof(sample)), sample


def test_a_library_built_ahead_of_time_is_called_without_numba(tmp_path):
    """The whole way: list, library, a process in which numba cannot be imported."""
    (tmp_path / "some_kernels.py").write_text(KERNELS)
    array = ["array", "float64", 1, "C", True]
    listed = {
        "some_kernels.scaled": [[["named", "some_kernels:Pair", array, "float64"], "float64"]],
        "some_kernels.count": [[["array", "bool", 1, "C", True]]],
    }
    (tmp_path / "kernels.json").write_text(json.dumps(listed))
    build = (
        "import sys; from pathlib import Path; import build_kernels as b; "
        f"b.LIST = Path(r'{tmp_path}') / 'kernels.json'; b.build(Path(r'{tmp_path}'), 'some_library')"
    )
    _python(build, tmp_path)
    use = (
        "import sys; sys.modules['numba'] = None\n"
        "from pathlib import Path; from skyway.models import kernel_library as k\n"
        f"k.LIST = Path(r'{tmp_path}') / 'kernels.json'\n"
        "import some_library; k.library = lambda: some_library\n"
        "import numpy; from some_kernels import scaled, count, Pair\n"
        "print(scaled(Pair(numpy.array([1.0, 2.0]), 3.0), 0.5).tolist(), count(numpy.array([True, False, True])))\n"
        "try:\n    count(numpy.array([1.0]))\nexcept k.KernelError as error:\n    print(error)\n"
    )
    told = _python(use, tmp_path)
    assert told.splitlines()[0] == "[3.5, 6.5] 2"
    assert "some_kernels.count was not compiled for arguments" in told
    assert "skyway-planner[jit]" in told


def _python(program: str, folder: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={"PYTHONPATH": f"{ROOT}:{folder}", "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
