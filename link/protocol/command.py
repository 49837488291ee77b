"""Commands with their acknowledgement, requests for single messages, and the choice of the current mission item."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from skyway.link.protocol.exchange import Question

if TYPE_CHECKING:
    from skyway.link.protocol.exchange import Target
    from skyway.link.wire.messages import Message

_PROGRESS_S = 15.0
ACCEPTED, IN_PROGRESS, UNSUPPORTED = 0, 5, 3
RESULTS = {
    0: "accepted",
    1: "not now, try again",
    2: "denied",
    3: "it does not support this command",
    4: "it failed",
    5: "in progress",
    6: "cancelled",
    7: "only as COMMAND_LONG",
    8: "only as COMMAND_INT",
    9: "an unsupported frame",
}
"""MAV_RESULT."""


class Place(NamedTuple):
    """Place at which a command is to be executed."""

    x: int
    y: int
    """`x`, `y`: latitude and longitude in 1e-7 degree."""
    z: float
    """Height, m."""
    frame: int
    """MAV_FRAME: the reference of the height."""


class Command(Question):
    """Sends a command (MAV_CMD) with its first parameters, the rest 0, and waits for its answer.

    With a place it is a COMMAND_INT. It ends without an answer after `give_up_s`.
    """

    def __init__(
        self, target: Target, number: int, *parameters: float, place: Place | None = None, give_up_s: float = 6.0
    ) -> None:
        values = [*parameters, *[0.0] * 7]
        fields = {f"param{n + 1}": values[n] for n in range(4 if place is not None else 7)}
        if place is not None:
            super().__init__(target, "COMMAND_INT", command=number, **place._asdict(), **fields)
        else:
            super().__init__(target, "COMMAND_LONG", command=number, **fields)
        self.number, self.place = number, place
        self.give_up_s = give_up_s
        self.result: int | None = None
        """MAV_RESULT; None: no answer."""

    def ask(self) -> None:
        """Send it; a COMMAND_LONG carries the number of attempts."""
        super().ask()
        if self.place is None:
            self.outbox[-1][1]["confirmation"] = min(self._tries, 255)

    def hear(self, message: Message, now_s: float) -> None:
        """End at the answer; progress reports extend the wait."""
        if message.name != "COMMAND_ACK" or message["command"] != self.number:
            return
        if message["result"] == IN_PROGRESS:
            self._end_s = self.next_s = now_s + _PROGRESS_S
            return
        self._learn(now_s)
        self.result = message["result"]
        self.finish()


class AskFor(Question):
    """Requests one message (REQUEST_MESSAGE) until it arrives; an answer to the command alone is not enough."""

    give_up_s = 6.0

    def __init__(self, target: Target, name: str, number: int, *, late_s: float = 0.2) -> None:
        """`late_s`: time after a refusal in which it may come all the same, as of a vehicle that streams it unasked."""
        super().__init__(target, "COMMAND_LONG", command=512, param1=float(number))
        self.name, self.number, self._late_s = name, number, late_s
        self.message: Message | None = None
        """The message; None: no answer."""

    def hear(self, message: Message, now_s: float) -> None:
        """Process the message; a refusal may arrive shortly before it."""
        if message.name == self.name:
            self.message = message
            self.finish()
        elif message.name == "COMMAND_ACK" and message["command"] == 512 and message["result"] not in (0, IN_PROGRESS):
            self._end_s = self.next_s = now_s + self._late_s


class SetCurrent(Question):
    """Makes an item the current one (MISSION_SET_CURRENT), confirmed by MISSION_CURRENT.

    Its number is the autopilot's; ArduPilot's 0 is the beginning.
    """

    def __init__(self, target: Target, number: int) -> None:
        super().__init__(target, "MISSION_SET_CURRENT", seq=number)
        self.number = number
        self.confirmed = False
        """Whether the vehicle confirms it."""

    def hear(self, message: Message, now_s: float) -> None:  # noqa: ARG002
        """End when it is confirmed."""
        if message.name == "MISSION_CURRENT" and message["seq"] == self.number:
            self.confirmed = True
            self.finish()
