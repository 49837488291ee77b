"""Operator control: the ground station in control of a vehicle, if the vehicle reports it (CONTROL_STATUS).

Source: https://github.com/mavlink/mavlink/pull/2313 (merged 2026), and #2158 for the layout before it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.link.protocol.command import Command

if TYPE_CHECKING:
    from skyway.link.protocol.connection import Peer
    from skyway.link.protocol.exchange import Target
    from skyway.link.wire.messages import Message

REQUEST_CONTROL = 32100
"""MAV_CMD_REQUEST_OPERATOR_CONTROL."""
STATUS = "CONTROL_STATUS"
_SYSTEM_MANAGER, _TAKEOVER_ALLOWED = 1, 2
ASK_S = 10.0
"""So long the station in control is asked to give way."""


def _status(peer: Peer) -> Message | None:
    """Return what it says of the control of the whole vehicle."""
    told = peer.latest.get(STATUS)
    return told if told is not None and told["flags"] & _SYSTEM_MANAGER else None


def controller(peer: Peer) -> int | None:
    """System of the station in control; 0 for none, None where the vehicle does not say."""
    told = _status(peer)
    return None if told is None else int(told["gcs_main"])


def allows_takeover(peer: Peer) -> bool:
    """Whether a request for control would be granted at once."""
    told = _status(peer)
    return told is not None and bool(told["flags"] & _TAKEOVER_ALLOWED)


def may_command(peer: Peer, system: int) -> bool:
    """Whether a station may give orders, as far as the vehicle reports."""
    told = _status(peer)
    return told is None or told["gcs_main"] in (0, system) or system in told["gcs_secondary"]


def request(target: Target, system: int) -> Command:
    """Ask for control, in the name of a station, without letting others take it over unasked."""
    return Command(target, REQUEST_CONTROL, 1.0, 0.0, ASK_S, float(system))


def release(target: Target, system: int) -> Command:
    """Give control back."""
    return Command(target, REQUEST_CONTROL, 0.0, 0.0, 0.0, float(system))
