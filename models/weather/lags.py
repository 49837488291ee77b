"""Changes of a model's forecasts from one issue to the next."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.weather.weather import EAST, NORTH, FieldKey

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.models.weather.weather import Weather


@dataclass(frozen=True, slots=True)
class Lag:
    """Two issues of one model, compared at the times and places that both have."""

    model: str
    earlier_s: float
    later_s: float
    """POSIX seconds of the issues."""
    height_m: float
    times: int
    rms_mps: float
    """Root of the mean square of the vector difference of their mean winds."""


def lags(weathers: Sequence[Weather]) -> list[Lag]:
    """Compare each issue with the next one of its model on the same grid."""
    found = []
    groups: dict[tuple[str, str], list[Weather]] = {}
    for one in weathers:
        if np.isfinite(one.issued_s) and one.wind_heights_m:
            groups.setdefault((one.model, one.places.kind), []).append(one)
    for (model, _), group in groups.items():
        for first, second in pairwise(sorted(group, key=lambda one: one.issued_s)):
            heights = sorted(set(first.wind_heights_m) & set(second.wind_heights_m))
            times, in_first, in_second = np.intersect1d(first.times_s, second.times_s, return_indices=True)
            if not heights or not len(times) or not first.places.same_as(second.places):
                continue
            square = 0.0
            for part in (NORTH, EAST):
                key = FieldKey(part, heights[0])
                before, after = first.fields[key].mean(axis=0)[in_first], second.fields[key].mean(axis=0)[in_second]
                square += float(np.nanmean((before - after) ** 2))
            found.append(Lag(model, first.issued_s, second.issued_s, heights[0], len(times), square**0.5))
    return found
