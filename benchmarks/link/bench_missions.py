"""How fast missions are read, checked and written, against the targets and against pymavlink.

Run it with ``python benchmarks/link/bench_missions.py``; figures are the best of several runs on this machine.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

from benchmarks.tables.figure import best_s
from skyway.missions import check
from skyway.missions.files import mission_file, plan_writer, waypoints_file
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.document import MissionDocument
from skyway.missions.items.mission import Home, Mission, MissionItem

ITEMS = 10_000
READ_TARGET_S = 0.3
CHECK_TARGET_S = 1.0


def large_document(count: int = ITEMS) -> MissionDocument:
    """A mission of many items: take-off, a long winding way with speed items, landing."""
    home = Home(Point.of_degrees(47.0, 8.0), 400.0)
    items = [_at(Command.NAV_TAKEOFF, 47.0, 8.0, 60.0)]
    for number in range(count - 2):
        if number % 20 == 19:
            items.append(MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, 5.0 + number % 10, -1.0))
            continue
        turn = number / 50.0
        items.append(_at(Command.NAV_WAYPOINT, 47.0 + 0.02 * math.sin(turn), 8.0 + 0.02 * math.cos(turn), 60.0))
    items.append(_at(Command.NAV_LAND, 47.0, 8.0, 0.0))
    return MissionDocument(Mission(tuple(items), home, firmware=12))


def _at(command: Command, lat: float, lon: float, z: float) -> MissionItem:
    point = Point.of_degrees(lat, lon)
    return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, param4=math.nan, x=point.lat_e7, y=point.lon_e7, z=z)


def measure() -> dict[str, float]:
    """Return every figure in seconds, and the ratio to pymavlink."""
    from pymavlink import mavwp

    document = large_document()
    with tempfile.TemporaryDirectory() as folder:
        plan, text = Path(folder) / "large.plan", Path(folder) / "large.waypoints"
        mission_file.write(document, plan)
        mission_file.write(document, text)
        figures = {
            "read .plan": best_s(lambda: mission_file.read(plan)),
            "check": best_s(lambda: check(document)),
            "write .plan": best_s(lambda: plan_writer.dumps(document)),
            "read .waypoints": best_s(lambda: mission_file.read(text)),
            "write .waypoints": best_s(lambda: waypoints_file.dumps_mission(document)),
            "read .waypoints, pymavlink": best_s(lambda: mavwp.MAVWPLoader().load(str(text))),
        }
    figures["times faster than pymavlink"] = figures["read .waypoints, pymavlink"] / figures["read .waypoints"]
    return figures


def main() -> None:
    """Print the figures."""
    print(f"{ITEMS} items")
    targets = {"read .plan": READ_TARGET_S, "check": CHECK_TARGET_S}
    for name, value in measure().items():
        if name.startswith("times"):
            print(f"{name:32s} {value:8.2f}")
            continue
        target = f"  (target {targets[name]:g} s)" if name in targets else ""
        print(f"{name:32s} {1000 * value:8.1f} ms{target}")


if __name__ == "__main__":
    main()
