"""The demonstration on the page: a simulated drone flies a real plan faster than real time, in separate processes."""

from __future__ import annotations

import socket
from contextlib import closing
from typing import TYPE_CHECKING

from skyway.demo import DRONE, PAYLOAD_KG, START, DemoOptions, plan_demo
from skyway.flights.starting import FlightOptions, start
from skyway.models.base.files import write_atomically

if TYPE_CHECKING:
    from pathlib import Path

SPEEDUP, PAD_SPEEDUP = 10.0, 60.0
"""Simulated seconds per second, in the air and on the ground."""
LONGEST_S = 8 * 3600.0
"""Simulated; the simulation ends by itself then."""
PLANNED = "demonstration-plan.json"
DRAG = "demonstration-drag.toml"


def prepare(folder: Path, *, planner: str = "") -> dict[str, str]:
    """Plan the delivery and calibrate its drone; returns what there is to fly: plan, drag, departure and ends."""
    from skyway.calibration_flight import drag_of
    from skyway.models.composition.file import save
    from skyway.models.drones.drag_file import drag_file
    from skyway.scenarios import load_scenario

    composition = plan_demo(DemoOptions(folder=folder, planner=planner))
    save(composition, folder / PLANNED, force=True)
    drag = drag_of(load_scenario(None).drone(DRONE), PAYLOAD_KG)
    write_atomically(folder / DRAG, drag_file(drag), force=True)
    return {
        "origin": composition.origin,
        "destination": composition.destination,
        "depart": composition.depart.isoformat(),
    }


def simulate(folder: Path, depart: str, *, speedup: float = SPEEDUP, seed: int = 1) -> tuple[str, str, Path]:
    """Start the simulation; returns the addresses of the drone and of the pads, and the file that it prints into."""
    drone, pads = _free_port(), _free_port()
    wind = depart[:10]
    words = [
        "sim", "--at", START, "--tcp", str(drone), "--pads", f"tcp:127.0.0.1:{pads}", "--wind", wind, "--depart", depart,
        "--payload", str(PAYLOAD_KG), "--warm", "--seed", str(seed), "--speedup", str(speedup),
        "--pad-speedup", str(max(PAD_SPEEDUP, speedup)), "--duration", str(LONGEST_S),
    ]  # fmt: skip
    output = folder / f"demonstration-{drone}.out"
    output.unlink(missing_ok=True)
    start(words, output)
    return f"tcp:127.0.0.1:{drone}", f"tcp:127.0.0.1:{pads}", output


def listens(output: Path) -> bool:
    """Whether a simulation that prints into a file can be connected to."""
    return output.is_file() and "pads" in output.read_text(encoding="utf-8", errors="replace").casefold()


def options(folder: Path, connect: str, pads: str, *, asks: bool) -> FlightOptions:
    """Return how the demonstration is flown."""
    return FlightOptions(plan=str(folder / PLANNED), connect=connect, pads=pads, drag=str(folder / DRAG), asks=asks)


def _free_port() -> int:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_STREAM)) as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])
