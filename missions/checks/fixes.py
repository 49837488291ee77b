"""Findings with only one correction: the form that a vehicle stores anyway."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.finding import Finding
    from skyway.missions.items.mission import MissionItem

CERTAIN = ("parameter-not-given", "fraction-lost")
"""Codes of such findings. Findings that allow several remedies (a missing landing, a wrong jump) are left to a person."""
_E7 = 10_000_000


def fixed(document: MissionDocument, findings: Sequence[Finding]) -> tuple[MissionDocument, tuple[str, ...]]:
    """Return the document with those findings fixed, and the changes, one a line.

    Items of a survey or another pattern stay as they are: changed, they could no longer be edited as one.
    """
    items = list(document.mission.items)
    patterns = document.mission.complex_items
    of_patterns = {number for one in patterns for number in range(one.first, one.first + one.count)}
    told = []
    for finding in findings:
        if finding.code not in CERTAIN or finding.item is None or finding.item in of_patterns:
            continue
        before = items[finding.item]
        after = _zeros(before) if finding.code == "parameter-not-given" else _whole(before)
        if after != before:
            items[finding.item] = after
            told.append(f"item {finding.item}: {finding.remedy}, as the vehicle does")
    if not told:
        return document, ()
    return replace(document, mission=replace(document.mission, items=tuple(items))), tuple(told)


def _zeros(item: MissionItem) -> MissionItem:
    """0 for parameters that are not given."""
    given = {f"param{number}": 0.0 for number, value in enumerate(item.params, start=1) if math.isnan(value)}
    return replace(item, **given)  # type: ignore[arg-type]


def _whole(item: MissionItem) -> MissionItem:
    """Whole numbers for the parameters that travel as such."""
    x, y = (None if value is None else round(value / _E7) * _E7 for value in (item.x, item.y))
    return replace(item, x=x, y=y)
