"""How a package leaves the drone, and its effect on the plan: whether the drone lands, and how long it hovers."""

from __future__ import annotations

from typing import Literal, get_args

Release = Literal["gripper", "winch", "place", "hand"]
"""``gripper``: it lands, and a gripper opens; ``hand``: it lands, and a person takes the package off and confirms it; ``winch``: it hovers and lowers the
package on a line; ``place``: it sinks until the package stands on the ground, lets go and climbs (ArduPilot's NAV_PAYLOAD_PLACE)."""
RELEASES: tuple[Release, ...] = get_args(Release)

WINCH_HEIGHT_M = 15.0
"""Above the ground at the target, where it hovers while the line is out."""
WINCH_SLACK_M = 1.0
"""Excess of line over height, so that the hook comes free."""
WINCH_MPS = 1.0
"""Line a second: WINCH_RATE_MAX, as ArduPilot has it by default."""
WINCH_SETTLE_S = 10.0
"""After the line is out, and after it is in: the last metre is slow."""
PLACE_HEIGHT_M, PLACE_MPS = 10.0, 0.5
"""It sinks from this height above the ground, with ArduPilot's LAND_SPEED."""
PLACE_LOWEST_M = -5.0
"""The descent is aborted this far below the known ground."""
PLACE_SETTLE_S = 10.0
"""Time to detect the ground, open the gripper and wait before the climb."""


def hovers(release: str) -> bool:
    """Whether the package is released in the air: the drone does not land at the target."""
    return release in ("winch", "place")


def winch_s() -> float:
    """Time for the line to go out, or to come in."""
    return (WINCH_HEIGHT_M + WINCH_SLACK_M) / WINCH_MPS + WINCH_SETTLE_S


def hover_s(release: str) -> float:
    """Time in the air at the target, beyond the descent and climb that a landing also takes."""
    if release == "winch":
        return 2.0 * winch_s()
    return PLACE_HEIGHT_M / PLACE_MPS + PLACE_SETTLE_S if release == "place" else 0.0
