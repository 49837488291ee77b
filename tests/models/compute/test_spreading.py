"""Work spread over processes and over a Dask cluster: the same answers in the same order, whatever is lost on the way."""

import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import study_pieces
from study_pieces import always_dies, dies_once, fails, squared

from skyway.models.base.errors import InputError, SkywayError
from skyway.models.compute.spreading import spread


def test_answers_are_in_order_and_progress_reaches_the_end():
    told = []
    assert spread(squared, range(5), told=lambda *one: told.append(one)) == [0, 1, 4, 9, 16]
    assert [one[:2] for one in told] == [(1, 5), (2, 5), (3, 5), (4, 5), (5, 5)]
    assert told[-1][2] == 0.0
    assert all(math.isfinite(one[2]) for one in told)
    assert spread(squared, [], workers=2) == []


@pytest.mark.slow
def test_a_cluster_that_is_not_there_is_one_line():
    pytest.importorskip("distributed", reason="Dask: pip install 'skyway-planner[cluster]'")
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        spread(squared, [1], cluster="nonsense")


@pytest.mark.slow
def test_processes_that_are_killed_are_replaced_and_their_work_is_done_again(tmp_path):
    pieces = [(number, str(tmp_path)) for number in range(23)]
    assert spread(dies_once, pieces, workers=2) == [number + 1 for number in range(23)]
    assert len(list(tmp_path.iterdir())) == 5


@pytest.mark.slow
def test_what_kills_its_workers_is_given_up_and_what_fails_is_told():
    with pytest.raises(SkywayError, match="workers were lost 3 times"):
        spread(always_dies, range(6), workers=2)
    with pytest.raises(ValueError, match="wrong at 0"):
        spread(fails, range(2), workers=2)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_workers_end_with_the_program_that_they_work_for(how, tmp_path):
    program = f"from study_pieces import told_and_asleep\nfrom skyway.models.compute.spreading import spread\nif __name__ == '__main__':\n    spread(told_and_asleep, [({str(tmp_path)!r}, n) for n in range(9)], workers=2)\n"
    script = tmp_path / "program.py"
    script.write_text(program)
    places = os.pathsep.join([str(Path(study_pieces.__file__).parent), *sys.path])
    process = subprocess.Popen([sys.executable, str(script)], env=os.environ | {"PYTHONPATH": places}, stderr=subprocess.PIPE, text=True)  # fmt: skip
    until = time.monotonic() + 60.0
    while len(list(tmp_path.glob("*.pid"))) < 2:
        assert time.monotonic() < until
        time.sleep(0.02)
    process.send_signal(how)
    _, said = process.communicate(timeout=30.0)
    for told in tmp_path.glob("*.pid"):
        while _runs(int(told.stem)):
            assert time.monotonic() < until, "a worker goes on"
            time.sleep(0.02)
    assert said.count("Traceback") <= 1  # of the program itself, which does not catch Ctrl-C here; none of its workers


def _runs(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
