"""Commands that end with the program whose lifeline they hold, however that ends."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks at processes in /proc")

HELD = "from skyway.models.compute.worker_processes import hold_lifeline as h; h(); print('held', flush=True); import time; time.sleep(60)"
PROGRAM = f"""
import subprocess, sys, time
from skyway.models.compute.worker_processes import lifeline
with lifeline() as environment:
    child = subprocess.Popen([sys.executable, "-c", {HELD!r}], env=environment, start_new_session=True)
    print(child.pid, flush=True)
    time.sleep(60)
"""


def runs(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_a_command_in_a_session_of_its_own_ends_with_the_program(how):
    program = subprocess.Popen([sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, text=True)
    child, held = int(program.stdout.readline()), program.stdout.readline()
    assert held == "held\n"
    assert runs(child)
    program.send_signal(how)
    program.wait(30.0)
    until = time.monotonic() + 30.0
    while runs(child):
        assert time.monotonic() < until, "it goes on"
        time.sleep(0.01)
    program.stdout.close()


def test_without_a_lifeline_nothing_is_held():
    done = subprocess.run(
        [sys.executable, "-c", HELD.replace("time.sleep(60)", "")],
        capture_output=True,
        text=True,
        timeout=30,
        check=True,
    )
    assert done.stdout == "held\n"
