"""Commands with their acknowledgement: COMMAND_LONG and COMMAND_INT, and requests for single messages."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from skyway.link.protocol.exchange import Exchange

if TYPE_CHECKING:
    from skyway.link.protocol.exchange import RoundTrip, Target
    from skyway.link.wire.messages import Message

GIVE_UP_S = 6.0
_PROGRESS_S = 15.0
ACCEPTED, IN_PROGRESS, UNSUPPORTED = 0, 5, 3
RESULTS = {
    0: "accepted",
    1: "not now, try again",
    2: "denied",
    3: "it does not know this command",
    4: "it failed",
    5: "in progress",
    6: "cancelled",
    7: "only as COMMAND_LONG",
    8: "only as COMMAND_INT",
    9: "an unsupported frame",
}
"""MAV_RESULT."""


class Place(NamedTuple):
    """Where a command is to be executed.

    Attributes
    ----------
    x, y : int
        Latitude and longitude in 1e-7 degree.
    z : float
        Height, m.
    frame : int
        MAV_FRAME: what the height counts from.
    """

    x: int
    y: int
    z: float
    frame: int


class Command(Exchange):
    """Gives a command and waits for the answer to it.

    Parameters
    ----------
    target : Target
        The vehicle.
    number : int
        MAV_CMD.
    parameters : float
        The first ones; the rest is 0.
    place : Place or None
        For COMMAND_INT.
    give_up_s : float
        Without an answer for so long, it ends.

    Attributes
    ----------
    result : int or None
        MAV_RESULT; None for silence.
    """

    def __init__(
        self,
        target: Target,
        number: int,
        *parameters: float,
        place: Place | None = None,
        round_trip: RoundTrip | None = None,
        give_up_s: float = GIVE_UP_S,
    ) -> None:
        super().__init__(target, round_trip)
        self.number, self.parameters, self.place = number, parameters, place
        self.give_up_s = give_up_s
        self.result: int | None = None
        self._tries = 0
        self._sent_s = self._end_s = 0.0

    def begin(self, now_s: float) -> None:
        """Give it."""
        self._end_s = now_s + self.give_up_s
        self._give(now_s)

    def _give(self, now_s: float) -> None:
        values = [*self.parameters, *[0.0] * 7]
        fields: dict[str, float] = {f"param{n + 1}": values[n] for n in range(4)}
        if self.place is not None:
            self.send("COMMAND_INT", command=self.number, **self.place._asdict(), **fields)
        else:
            fields |= {f"param{n + 1}": values[n] for n in range(4, 7)}
            self.send("COMMAND_LONG", command=self.number, confirmation=min(self._tries, 255), **fields)
        self._sent_s = now_s
        self._tries += 1
        self.next_s = now_s + max(self.round_trip.retry_s(self._tries), 0.1)

    def hear(self, message: Message, now_s: float) -> None:
        """End at the answer; progress lengthens the wait."""
        if message.name != "COMMAND_ACK" or message["command"] != self.number:
            return
        if message["result"] == IN_PROGRESS:
            self._end_s = now_s + _PROGRESS_S
            self.next_s = now_s + _PROGRESS_S
            return
        if self._tries == 1:
            self.round_trip.learn(now_s - self._sent_s)
        self.result = message["result"]
        self.finish()

    def tick(self, now_s: float) -> None:
        """Give it again."""
        if now_s >= self._end_s:
            self.finish()
        else:
            self._give(now_s)


class AskFor(Exchange):
    """Asks for one message (REQUEST_MESSAGE) until it comes; an answer to the command alone is not enough.

    Attributes
    ----------
    message : Message or None
        What came; None for nothing.
    """

    def __init__(self, target: Target, name: str, number: int, *, round_trip: RoundTrip | None = None) -> None:
        super().__init__(target, round_trip)
        self.name, self.number = name, number
        self.message: Message | None = None
        self._tries = 0
        self._end_s = 0.0
        self._refused = False

    def begin(self, now_s: float) -> None:
        """Ask."""
        self._end_s = now_s + GIVE_UP_S
        self._ask(now_s)

    def _ask(self, now_s: float) -> None:
        self.send("COMMAND_LONG", command=512, param1=float(self.number))
        self._tries += 1
        self.next_s = now_s + max(self.round_trip.retry_s(self._tries), 0.1)

    def hear(self, message: Message, now_s: float) -> None:
        """Take the message; a refusal may be overtaken by it for a moment."""
        if message.name == self.name:
            self.message = message
            self.finish()
        elif message.name == "COMMAND_ACK" and message["command"] == 512 and message["result"] not in (0, IN_PROGRESS):
            self._refused = True
            self.next_s = now_s + 0.2

    def tick(self, now_s: float) -> None:
        """Ask again."""
        if self._refused or now_s >= self._end_s:
            self.finish()
        else:
            self._ask(now_s)
