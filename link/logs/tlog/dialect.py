"""MAVLink message types of pymavlink's widest dialect, as tables."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.link.logs.tlog.tlog_kernels import DENSE_IDS

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class MessageType:
    """One type of message."""

    id: int
    """As sent."""
    name: str
    """Such as ``ATTITUDE``."""
    layout: np.dtype[np.void]
    """Of the payload on the wire, little-endian and packed."""


@cache
def _all_types() -> dict[int, Any]:
    from pymavlink.dialects.v20 import all as dialect

    return dict(dialect.mavlink_map)


@cache
def crc_extras() -> NDArray[np.int16]:
    """Extra checksum byte of each message type, shape (65536,); -1 where the type is unknown."""
    table = np.full(DENSE_IDS, -1, dtype=np.int16)
    for number, kind in _all_types().items():
        table[number] = kind.crc_extra
    return table


def name_of(number: int) -> str:
    """Return the name of a message type; ``UNKNOWN_`` and its id where it is unknown, like pymavlink."""
    kind = _all_types().get(number)
    return f"UNKNOWN_{number}" if kind is None else str(kind.msgname)


@cache
def message_type(name: str) -> MessageType:
    """Return a message type by its name."""
    kind = next(kind for kind in _all_types().values() if kind.msgname == name)
    wire = bytes(kind.native_format).decode().lstrip("<")
    fields: list[Any] = []
    for field, code, count in zip(kind.ordered_fieldnames, wire, kind.array_lengths, strict=True):
        if code == "c":
            fields.append((field, f"S{max(count, 1)}"))
        else:
            fields.append((field, f"<{code}", count) if count else (field, f"<{code}"))
    return MessageType(int(kind.id), name, np.dtype(fields))
