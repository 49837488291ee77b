"""Findings of mission checks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning", "info"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding, with its remedy."""

    severity: Severity
    """``error``: it will not fly, or not safely; ``warning``: needs attention; ``info``: for information."""
    item: int | None
    """Number of the item, home not counted; None concerns the whole mission."""
    code: str
    """Stable identifier, for machines."""
    message: str
    """The finding."""
    remedy: str | None = None
    """The remedy."""

    def __str__(self) -> str:
        where = "mission" if self.item is None else f"item {self.item}"
        text = f"{self.severity}: {where}: {self.message} [{self.code}]"
        return f"{text}; {self.remedy}" if self.remedy else text
