"""Pieces of work for tests of spreading: functions that processes can import."""

import os
import signal
import time
from pathlib import Path


def squared(number):
    return number * number


def dies_once(piece):
    """End its process with SIGKILL the first time that a piece is begun; its file says whether it was."""
    number, folder = piece
    marker = Path(folder) / f"{number}"
    if number % 5 == 0 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number + 1


def always_dies(number):
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def fails(number):
    raise ValueError(f"wrong at {number}")


def told_and_asleep(piece):
    """A piece that writes which process it is in, and takes long."""
    folder, _ = piece
    (Path(folder) / f"{os.getpid()}.pid").touch()
    time.sleep(600.0)
