"""References between items: from the numbers of a file to ours."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.missions.items.commands import INDEX_COMMANDS, Command

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.missions.items.mission import MissionItem
    from skyway.models.base.errors import InputError


def refers_to(item: MissionItem) -> int | None:
    """Return the number that an item refers to; None if it refers to none, or to no particular one."""
    target = item.jump_target
    return None if target is None or (item.command == Command.DO_SET_MISSION_CURRENT and target < 0) else target


def resolved(
    items: Sequence[MissionItem],
    numbers: Sequence[int | None],
    first: int,
    ambiguous: Callable[[int, int], InputError],
) -> tuple[MissionItem, ...]:
    """Return items whose references are our numbers; a reference to a missing item stays out of range.

    `numbers` are those of the items in the file; without them, they count from `first`. `ambiguous` makes the
    error for an item, by our number, and a number that several items have.
    """
    found = list(items)
    if not any(item.command in INDEX_COMMANDS for item in items):
        return tuple(found)
    counts = Counter(numbers)
    places = {number: index for index, number in enumerate(numbers) if number is not None}
    for index, item in enumerate(items):
        wanted = refers_to(item)
        if wanted is None:
            continue
        if counts[wanted] > 1:
            raise ambiguous(index, wanted)
        target = places.get(wanted, wanted - first)
        if wanted not in places and 0 <= target < len(found):
            target += len(found)
        found[index] = replace(item, param1=float(target))
    return tuple(found)
