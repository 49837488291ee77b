"""Kernels compiled ahead of time give what numba gives; the list of them fits the source."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import build_kernels
from skyway.models.jit import library as kernel_library
from skyway.models.jit.library import kind_of

ROOT = Path(__file__).parents[3]
KERNELS = """
import numpy
from typing import NamedTuple
from skyway.models.jit.compiled import compiled, compiled_lean

class Pair(NamedTuple):
    values: numpy.ndarray
    factor: float

@compiled_lean
def times(value, factor):
    return value * factor

@compiled
def scaled(pair, offset):
    out = numpy.empty(len(pair.values))
    for k in range(len(pair.values)):
        out[k] = times(pair.values[k], pair.factor) + offset
    return out

@compiled
def count(flags):
    total = 0
    for flag in flags:
        total += flag
    return total
"""


def test_every_listed_kernel_is_in_the_source_and_called_from_python():
    assert set(kernel_library.listed()) == build_kernels.entries()  # one that is not listed needs a compiler


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
    assert called_from_python(COMMANDS.format(root=ROOT)) == "[0, 0, 0, 0, 0, 0, 0] []", "run: make kernels"


def called_from_python(program):
    """What a program prints of the kernels that it called, which the first time include those compiled for their callers alone."""
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        if done.stdout.strip().endswith(" []"):
            break
    return done.stdout.strip()


LOGS = """
import sys; sys.path.insert(0, r'{root}')
import warnings; warnings.simplefilter("ignore")
import build_kernels, json
from pathlib import Path
from skyway.link.logs.reader import open_log
for path in sorted(Path(r'{folder}').iterdir()):
    if path.suffix != ".md":
        log = open_log(path)
        pieces = [*log.tracks(), *log.tracks(from_s=log.summary.start_s + 20.0)]
listed = json.loads(build_kernels.LIST.read_text())
called = build_kernels.observed()
print(len(called), [name for name, kinds in called.items() if any(kind not in listed.get(name, []) for kind in kinds)])
"""


def test_every_kernel_that_reads_a_log_is_listed(shared_data):
    count, missing = called_from_python(LOGS.format(root=ROOT, folder=shared_data / "logs")).split(" ", 1)
    assert int(count) >= 6
    assert missing == "[]", "run: make kernels"


def test_types_are_told_apart_as_numba_does():
    from numba import typeof

    values = np.arange(6.0).reshape(2, 3)
    frozen = values.copy()
    frozen.setflags(write=False)
    samples = [1, 1.5, True, None, np.float32(1), np.int64(3), values, values.T, values[:, ::2], frozen, values > 1]
    samples += [(1, 2.0), (values, (1, 2)), np.arange(3, dtype=np.uint8)]
    for sample in samples:
        assert json.loads(json.dumps(kind_of(sample))) == build_kernels._kind(typeof(sample)), sample


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Folder with a module of kernels, a list of them and the library that was built from it; as a wheel has them."""
    folder = tmp_path_factory.mktemp("wheel")
    (folder / "some_kernels.py").write_text(KERNELS)
    array = ["array", "float64", 1, "C", True]
    listed = {
        "some_kernels.scaled": [[["named", "some_kernels:Pair", array, "float64"], "float64"]],
        "some_kernels.count": [[["array", "bool", 1, "C", True]]],
        "some_kernels.times": [["float64", "float64"]],
    }
    (folder / "kernels.json").write_text(json.dumps(listed))
    build = (
        "import sys; from pathlib import Path; import build_kernels as b; "
        f"b.LIST = Path(r'{folder}') / 'kernels.json'; b.build(Path(r'{folder}'), 'some_library')"
    )
    _python(build, folder)
    return folder


USE = """
from pathlib import Path; from skyway.models.jit import library as k
k.LIST = Path(r'{folder}') / 'kernels.json'
import some_library; k.library = lambda: some_library
import numpy; from some_kernels import scaled, count, Pair
"""


def test_a_library_built_ahead_of_time_is_called_without_numba(built):
    """The whole way: list, library, a process in which numba cannot be imported."""
    use = (
        f"import sys; sys.modules['numba'] = None\n{USE.format(folder=built)}"
        "print(scaled(Pair(numpy.array([1.0, 2.0]), 3.0), 0.5).tolist(), count(numpy.array([True, False, True])))\n"
        "try:\n    count(numpy.array([1.0]))\nexcept k.KernelError as error:\n    print(error)\n"
    )
    told = _python(use, built)
    assert told.splitlines()[0] == "[3.5, 6.5] 2"
    assert "some_kernels.count was not compiled for arguments" in told
    assert "skyway-planner[jit]" in told


@pytest.mark.slow
def test_with_numba_beside_a_library_kernels_take_any_types_and_so_do_those_that_they_call(built):
    """A kernel of the library calls others of the library, which numba cannot type."""
    use = (
        f"{USE.format(folder=built)}"
        "listed = scaled(Pair(numpy.array([1.0, 2.0]), 3.0), 0.5).tolist()\n"
        "import sys; compiles = 'numba' in sys.modules\n"
        "narrow = Pair(numpy.array([1, 2], dtype=numpy.int32), 3.0)\n"
        "print(listed, compiles, scaled(narrow, 0.5).tolist(), scaled(narrow, 1).tolist(), count(numpy.array([1.0, 2.0])))"
    )
    for _ in range(2):  # compiled, then from the cache
        assert _python(use, built) == "[3.5, 6.5] False [3.5, 6.5] [4.0, 7.0] 3.0\n"


def test_a_kernel_whose_source_has_changed_since_the_library_was_built_is_compiled(built, tmp_path):
    for path in built.iterdir():
        if path.is_file():
            (tmp_path / path.name).write_bytes(path.read_bytes())
    use = f"{USE.format(folder=tmp_path)}print(scaled(Pair(numpy.array([1.0, 2.0]), 3.0), 0.5).tolist())"
    assert _python(use, tmp_path) == "[3.5, 6.5]\n"
    source = tmp_path / "some_kernels.py"
    source.write_text(source.read_text().replace("value * factor", "value / (factor + 1.0)"))
    assert _python(use, tmp_path) != "[3.5, 6.5]\n"


PLAN = """
import contextlib, io
from skyway.models.jit import library as k
k.library, k.listed = (lambda: k), dict
from skyway.cli.main import main
from skyway.planner.robust.charge_kernels import fly_by_required_soc
trip = ["--from", "bellevue", "--to", "jacobi", "--payload", "0.8", "--depart", "2013-07-10T14:00-04:00", "--drone", "m200"]
with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
    codes = [main(["plan", *trip, "--planner", name]) for name in ("robust", "exact")]
print(codes, type(fly_by_required_soc).__name__)
"""


@pytest.mark.slow
def test_with_numba_beside_it_a_library_that_lacks_every_kernel_plans_all_the_same(tmp_path):
    """Every kernel of planning is compiled as one beside a wheel is: none depends on a callee that is in the library."""
    assert _python(PLAN, tmp_path) == "[0, 0] LibraryKernel\n"


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


@pytest.mark.slow
def test_a_kernel_whose_types_have_changed_since_the_library_was_built_is_compiled(built, tmp_path):
    """The library is asked by numbers of the list: another list would call machine code for other arguments."""
    for path in built.iterdir():
        if path.is_file():
            (tmp_path / path.name).write_bytes(path.read_bytes())
    path = tmp_path / "kernels.json"
    listed = json.loads(path.read_text())
    listed["some_kernels.times"].insert(0, ["int64", "int64"])
    path.write_text(json.dumps(listed))
    use = (
        f"{USE.format(folder=tmp_path)}from some_kernels import times\n"
        "asked = [k.in_library(f'some_kernels.{one.__name__}', one.skyway_stamp) for one in (scaled, times)]\n"
        "print(times(3, 4), times(0.5, 4.0), *asked)"
    )
    assert _python(use, tmp_path) == "12 2.0 True False\n"
