"""Findings of mission checks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning", "info"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding, with its remedy."""

    severity: Severity
    """``error``: it will not fly, or not safely; ``warning``: look at it; ``info``: worth knowing."""
    item: int | None
    """Number of the item, home not counted; None concerns the whole mission."""
    code: str
    """Stable name, for machines."""
    message: str
    """What was found."""
    remedy: str | None = None
    """What would be right."""

    def __str__(self) -> str:
        where = "mission" if self.item is None else f"item {self.item}"
        text = f"{self.severity}: {where}: {self.message} [{self.code}]"
        return f"{text}; {self.remedy}" if self.remedy else text
