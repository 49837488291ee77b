"""Socket endpoints of the loop."""

from __future__ import annotations

from typing import Protocol


class Endpoint(Protocol):
    """Something with a socket in the loop; never blocking, closed on any error.

    Attributes
    ----------
    where : str
        How it can be reached.
    """

    where: str

    def readable(self) -> None:
        """Read what is there."""
        ...

    def flush(self, now_s: float) -> None:
        """Send what is waiting."""
        ...

    def next_s(self) -> float:
        """Wall instant at which a delayed packet is due."""
        ...

    def close(self) -> None:
        """Close for good."""
        ...
