"""The states of a supervised delivery, their transitions, and their time limits: one table.

Picture and table in the documentation are generated from it, and the supervisor permits no other transition.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from skyway.models.base.errors import SkywayError

if TYPE_CHECKING:
    from collections.abc import Mapping


class State(StrEnum):
    """State of a supervised delivery."""

    CONNECTING = "connecting"
    REPLANNING = "replanning"
    WAITING = "waiting-for-pad"
    CHARGING = "charging"
    PREFLIGHT = "preflight"
    UPLOADING = "uploading"
    READY = "ready"
    ARMING = "arming"
    FLYING = "flying"
    DIVERTING = "diverting"
    LANDED = "landed"
    LOST_LINK = "lost-link"
    HOLDING = "holding"
    DELIVERED = "delivered"
    DONE = "done"
    STOPPED = "stopped-safe"
    ENDED_ELSEWHERE = "landed-elsewhere"
    CRASHED = "crashed"
    LEFT = "left-to-itself"


@dataclass(frozen=True, slots=True)
class Rule:
    """Rules of a state."""

    following: tuple[State, ...]
    """Next states; empty for an end."""
    longest_s: float
    """Time limit."""
    overdue: State | None
    """Next state when the time limit is exceeded."""
    meaning: str
    """Description, one line."""


_S = State
_GROUND_TROUBLE = (_S.STOPPED, _S.CRASHED, _S.HOLDING, _S.LOST_LINK, _S.LEFT)
_AIR_TROUBLE = (_S.HOLDING, _S.LOST_LINK, _S.LEFT)

TABLE: Mapping[State, Rule] = {
    _S.CONNECTING: Rule(
        (_S.REPLANNING, _S.FLYING, _S.DIVERTING, _S.LANDED, *_GROUND_TROUBLE, _S.DELIVERED),
        120.0,
        _S.STOPPED,
        "identify the drone and its position; after a resume, also what it was doing",
    ),
    _S.REPLANNING: Rule(
        (_S.WAITING, _S.PREFLIGHT, _S.REPLANNING, *_GROUND_TROUBLE),
        24 * 3600.0,
        _S.STOPPED,
        "on the ground: choose the next leg, its charge, and whether to wait for wind",
    ),
    _S.WAITING: Rule(
        (_S.CHARGING, _S.REPLANNING, *_GROUND_TROUBLE),
        12 * 3600.0,
        _S.STOPPED,
        "disarmed on a holding spot until a pad is free",
    ),
    _S.CHARGING: Rule(
        (_S.REPLANNING, _S.WAITING, *_GROUND_TROUBLE), 12 * 3600.0, _S.STOPPED, "disarmed on a pad, charging"
    ),
    _S.PREFLIGHT: Rule(
        (_S.UPLOADING, _S.REPLANNING, *_GROUND_TROUBLE), 900.0, _S.STOPPED, "checks before the take-off"
    ),
    _S.UPLOADING: Rule(
        (_S.READY, _S.PREFLIGHT, *_GROUND_TROUBLE),
        900.0,
        _S.STOPPED,
        "send fence, rally points and mission, read them back",
    ),
    _S.READY: Rule(
        (_S.ARMING, _S.REPLANNING, _S.PREFLIGHT, *_GROUND_TROUBLE),
        3600.0,
        _S.STOPPED,
        "wait for the operator to allow the take-off",
    ),
    _S.ARMING: Rule(
        (_S.FLYING, _S.PREFLIGHT, *_GROUND_TROUBLE), 600.0, _S.STOPPED, "arm and start, until the drone is in the air"
    ),
    _S.FLYING: Rule(
        (_S.LANDED, _S.DIVERTING, *_AIR_TROUBLE),
        4 * 3600.0,
        _S.HOLDING,
        "fly the leg, and watch progress, charge and wind",
    ),
    _S.DIVERTING: Rule(
        (_S.LANDED, _S.DIVERTING, *_AIR_TROUBLE),
        4 * 3600.0,
        _S.HOLDING,
        "fly to a station within safe reach, or land where it is",
    ),
    _S.LANDED: Rule(
        (_S.REPLANNING, _S.DELIVERED, _S.DONE, _S.ENDED_ELSEWHERE, *_GROUND_TROUBLE),
        1800.0,
        _S.HOLDING,
        "on the ground and disarmed: find the station, hand over the package",
    ),
    _S.LOST_LINK: Rule(
        (
            _S.CONNECTING,
            _S.FLYING,
            _S.DIVERTING,
            _S.LANDED,
            _S.HOLDING,
            _S.REPLANNING,
            _S.WAITING,
            _S.CHARGING,
            _S.PREFLIGHT,
            _S.STOPPED,
            _S.LEFT,
            _S.DELIVERED,
        ),
        3600.0,
        _S.LEFT,
        "no contact: the drone follows its failsafe parameters; skyway sends no commands",
    ),
    _S.HOLDING: Rule(
        (
            _S.FLYING,
            _S.DIVERTING,
            _S.LANDED,
            _S.LOST_LINK,
            _S.STOPPED,
            _S.ENDED_ELSEWHERE,
            _S.CRASHED,
            _S.LEFT,
            _S.REPLANNING,
        ),
        math.inf,
        None,
        "somebody else has control: skyway sends no commands until the operator answers",
    ),
    _S.DELIVERED: Rule((), math.inf, None, "the package has arrived, the drone stands disarmed"),
    _S.DONE: Rule((), math.inf, None, "the work is done, the drone stands disarmed where it ends"),
    _S.STOPPED: Rule((), math.inf, None, "on the ground at a known place, disarmed, not delivered"),
    _S.ENDED_ELSEWHERE: Rule((), math.inf, None, "on the ground, disarmed, away from any station"),
    _S.CRASHED: Rule((), math.inf, None, "on the ground after a crash or a roll-over: go there"),
    _S.LEFT: Rule((), math.inf, None, "the program has ended; the drone follows its parameters"),
}

IN_AIR = frozenset({State.FLYING, State.DIVERTING})
"""States in which the vehicle should fly under our mission."""
ON_GROUND = frozenset({State.REPLANNING, State.WAITING, State.CHARGING, State.PREFLIGHT, State.UPLOADING, State.READY})
"""States in which the vehicle should stand disarmed."""
ENDS = frozenset(state for state, rule in TABLE.items() if not rule.following)
"""States in which a delivery ends."""


class OffTableError(SkywayError):
    """The supervisor was about to make a transition that the table of states does not have."""

    exit_code = 3


class Turn(Exception):  # noqa: N818  not an error: the next state, from wherever in a state it is found out
    """Transition of the delivery to another state, raised during an action."""

    def __init__(self, state: State, reason: str) -> None:
        super().__init__(reason)
        self.state, self.reason = state, reason


@dataclass(slots=True)
class Status:
    """The state of one delivery; written only by `enter`."""

    entered_s: float = 0.0
    """Start of the present state, by the clock."""
    state: State = State.CONNECTING
    before: State = State.CONNECTING
    """The state before a lost link or a hold."""

    def enter(self, after: State, now_s: float) -> None:
        """Enter the next state. Raises an `OffTableError` if the table does not allow it."""
        check(self.state, after)
        aside = (State.LOST_LINK, State.HOLDING)
        if self.state not in aside or after not in aside:
            self.before = self.state
        if after is not self.state:
            self.entered_s = now_s
        self.state = after


def check(before: State, after: State) -> None:
    """Raise `OffTableError` for a transition that the table does not allow."""
    if after not in TABLE[before].following:
        raise OffTableError(
            f"no transition from the state {before} to {after}: this is a defect in skyway, please report it"
        )
