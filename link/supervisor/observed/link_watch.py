"""Whether the vehicle is in contact and answers: a request is repeated while there is time; a silent vehicle is a lost link."""

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
"""Time without a message after which the link is lost, s."""
ASK_AGAIN_S, ASK_FOR_S = 2.0, 900.0
"""Interval and total time of the repetitions of an unanswered request, s."""
FLYING_RATES: Mapping[int, float] = {30: 5.0, 33: 5.0, 74: 1.0, 1: 1.0, 245: 2.0, 42: 2.0, 2: 1.0, 168: 1.0}
GROUND_RATES: Mapping[int, float] = {30: 1.0, 33: 2.0, 74: 0.5, 1: 1.0, 245: 1.0, 42: 1.0, 2: 1.0, 168: 0.2, 24: 0.5}
"""Messages per second on the ground, before a take-off and after a landing."""
RESTING_RATES: Mapping[int, float] = dict.fromkeys((*GROUND_RATES, 31, 32, 65, 141, 147, 230, 242), 0.2)
"""Messages per second while the vehicle charges or waits, possibly for hours. Unrequested messages of some
autopilots are slowed down too."""
UNREAD = (31, 32, 65, 141)
"""Unrequested messages of some autopilots, up to seven per second in all, that nobody here reads: slowed down as
well if no other station is on the link."""
AWAKE_S = 2.0
"""Time to receive telemetry after a rest, s, so that the data are current."""


@dataclass(slots=True)
class LinkWatch:
    """Missing answers reported to the operator, and whether only few messages are requested."""

    resting: bool = False
    """The vehicle sends `RESTING_RATES`."""
    slowed: bool = False
    """The vehicle sends `UNREAD` at a low rate."""
    radios: RadioWatch = field(default_factory=RadioWatch)
    """Quality of each radio."""
    _reported: str = ""

    def is_new(self, missing: str) -> bool:
        """Whether a missing answer has not yet been reported to the operator; marks it as reported."""
        new, self._reported = missing != self._reported, missing
        return new

    def restarted(self) -> None:
        """Reset the requested rates: after a restart the vehicle sends its usual messages."""
        self.slowed = False

    def found_again(self) -> None:
        """Forget the missing answers: the link is back."""
        self._reported = ""


def ask(ctx: Context, question: Callable[[], T]) -> T:
    """Send a request that is not urgent, and repeat it until it is answered.

    If nothing is answered any more the link is lost (a `Turn`). If other requests are answered, and this one has not been
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
    """Report an unanswered request or a missing message; if nothing else is answered either the link is lost (a `Turn`)."""
    must_answer(ctx, str(what))
    if ctx.link.is_new(str(what)):
        ctx.say(LinkNote(), f"{what}; asking again")


def must_answer(ctx: Context, reason: str) -> None:
    """Return if the vehicle answers at all; otherwise the link is lost (a `Turn`), with this reason."""
    if not ctx.vehicle.answers():
        raise Turn(State.LOST_LINK, reason)


def must_be_in_contact(ctx: Context) -> None:
    """Return if the vehicle is in contact, or the link is known to be lost; otherwise it is lost now (a `Turn`)."""
    if ctx.state is not State.LOST_LINK and ctx.vehicle.silent_s > SILENT_S:
        raise Turn(State.LOST_LINK, f"nothing was heard from the drone for {duration(ctx.vehicle.silent_s)}")


def request_telemetry(ctx: Context) -> None:
    """Request the messages of the present state."""
    wanted = FLYING_RATES if ctx.state in IN_AIR or ctx.in_air else GROUND_RATES
    usual = dict.fromkeys(RESTING_RATES.keys() - wanted.keys() - _unread(ctx), 0.0) if ctx.link.resting else {}
    slow = {} if ctx.link.slowed else {number: RESTING_RATES[number] for number in _unread(ctx)}
    ctx.link.resting, ctx.link.slowed = False, True
    _request(ctx, {**wanted, **usual, **slow})


def _unread(ctx: Context) -> set[int]:
    """Messages that the vehicle sends and nobody reads; none if another station on our link may read them."""
    connection, received = ctx.vehicle.connection, ctx.vehicle.peer.latest
    shared = connection.forwarder is not None or connection.shared_client is not None
    return set() if shared else {number for number in UNREAD if kinds()[number].name in received}


def rest(ctx: Context) -> None:
    """Request few messages, before a long time on the ground."""
    if not ctx.link.resting:
        ctx.link.resting = True
        _request(ctx, RESTING_RATES)


def wake(ctx: Context) -> None:
    """Request the usual messages again, and wait until they arrive."""
    if ctx.link.resting:
        request_telemetry(ctx)
        ctx.wait(AWAKE_S)


def _request(ctx: Context, rates_hz: Mapping[int, float]) -> None:
    try:
        ctx.vehicle.request_telemetry(rates_hz)
    except LinkError as error:
        ctx.note(LinkNote(), f"telemetry could not be requested: {error}")
