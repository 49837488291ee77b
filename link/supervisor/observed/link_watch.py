"""Whether the vehicle is heard and answers: a request is repeated while there is time; a silent vehicle is a lost link."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

from skyway.link.supervisor.journal.entries import LinkNote
from skyway.link.supervisor.observed.radio_watch import RadioWatch
from skyway.link.supervisor.states import IN_AIR, State, Turn
from skyway.link.wire.messages import kinds
from skyway.models.base.errors import LinkError, VehicleTimeoutError
from skyway.models.base.formatting import duration

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from skyway.link.supervisor.context import Context

T = TypeVar("T")
SILENT_S = 5.0
"""Not heard for so long, the link is lost."""
ASK_AGAIN_S, ASK_FOR_S = 2.0, 900.0
"""A question without an answer is asked again after so long, for so long."""
FLYING_RATES: Mapping[int, float] = {30: 5.0, 33: 5.0, 74: 1.0, 1: 1.0, 245: 2.0, 42: 2.0, 2: 1.0, 168: 1.0}
GROUND_RATES: Mapping[int, float] = {30: 1.0, 33: 2.0, 74: 0.5, 1: 1.0, 245: 1.0, 42: 1.0, 2: 1.0, 168: 0.2, 24: 0.5}
"""Messages a second on the ground, before a take-off and after a landing."""
RESTING_RATES: Mapping[int, float] = dict.fromkeys((*GROUND_RATES, 31, 32, 65, 141, 147, 230, 242), 0.2)
"""The same while it charges or waits, perhaps for hours. What some autopilots send unasked is slowed down too."""
UNREAD = (31, 32, 65, 141)
"""What some autopilots send unasked, up to seven times a second in all, and nobody here reads: slowed down as well where only we listen."""
AWAKE_S = 2.0
"""So long we listen after a rest, so that what is known is of now."""


@dataclass(slots=True)
class LinkWatch:
    """Reports to the operator about missing answers, and whether only few messages are requested."""

    resting: bool = False
    """The vehicle sends `RESTING_RATES`."""
    slowed: bool = False
    """It sends little of what is `UNREAD`."""
    radios: RadioWatch = field(default_factory=RadioWatch)
    """How good each radio is."""
    _told: str = ""

    def is_new(self, missing: str) -> bool:
        """Whether the operator has not yet been told that this is missing; marks it as told."""
        new, self._told = missing != self._told, missing
        return new

    def restarted(self) -> None:
        """Forget what the vehicle was asked to send less of: after a restart it sends its usual messages."""
        self.slowed = False

    def found_again(self) -> None:
        """Forget what was missing: the link is back."""
        self._told = ""


def ask(ctx: Context, question: Callable[[], T]) -> T:
    """Put a question to a vehicle that has time, and put it again until it is answered.

    Where nothing is answered any more the link is lost (a `Turn`). Where all else is answered, and this has not been
    for `ASK_FOR_S`, it is a `VehicleTimeoutError`.
    """
    end = ctx.clock.now_s() + ASK_FOR_S
    while True:
        try:
            return question()
        except VehicleTimeoutError as error:
            unanswered(ctx, error)
            if ctx.clock.now_s() >= end:
                raise
            ctx.wait(ASK_AGAIN_S)


def unanswered(ctx: Context, what: VehicleTimeoutError | str) -> None:
    """Report an unanswered request or a missing message; the link is lost (a `Turn`) where nothing else is answered either."""
    must_answer(ctx, str(what))
    if ctx.link.is_new(str(what)):
        ctx.say(LinkNote(), f"{what}; asking again")


def must_answer(ctx: Context, reason: str) -> None:
    """Go on where the vehicle answers at all; else the link is lost (a `Turn`), with this reason."""
    if not ctx.vehicle.answers():
        raise Turn(State.LOST_LINK, reason)


def must_be_heard(ctx: Context) -> None:
    """Go on where the vehicle is heard, or the link is known to be lost; else it is lost now (a `Turn`)."""
    if ctx.state is not State.LOST_LINK and ctx.vehicle.silent_s > SILENT_S:
        raise Turn(State.LOST_LINK, f"nothing was heard from the drone for {duration(ctx.vehicle.silent_s)}")


def request_telemetry(ctx: Context) -> None:
    """Ask for the messages of the state we are in."""
    wanted = FLYING_RATES if ctx.state in IN_AIR or ctx.in_air else GROUND_RATES
    usual = dict.fromkeys(RESTING_RATES.keys() - wanted.keys() - _unread(ctx), 0.0) if ctx.link.resting else {}
    slow = {} if ctx.link.slowed else {number: RESTING_RATES[number] for number in _unread(ctx)}
    ctx.link.resting, ctx.link.slowed = False, True
    _request(ctx, {**wanted, **usual, **slow})


def _unread(ctx: Context) -> set[int]:
    """What the vehicle sends and nobody reads: another station on our link may read it."""
    connection, heard = ctx.vehicle.connection, ctx.vehicle.peer.latest
    shared = connection.forwarder is not None or connection.shared_client is not None
    return set() if shared else {number for number in UNREAD if kinds()[number].name in heard}


def rest(ctx: Context) -> None:
    """Ask for few messages, before a long time on the ground."""
    if not ctx.link.resting:
        ctx.link.resting = True
        _request(ctx, RESTING_RATES)


def wake(ctx: Context) -> None:
    """Ask for the usual messages again, and listen until they have come."""
    if ctx.link.resting:
        request_telemetry(ctx)
        ctx.wait(AWAKE_S)


def _request(ctx: Context, rates_hz: Mapping[int, float]) -> None:
    try:
        ctx.vehicle.request_telemetry(rates_hz)
    except LinkError as error:
        ctx.note(LinkNote(), f"telemetry could not be requested: {error}")
