"""Weighted statistics."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def weighted_quantile(values: NDArray[np.float64], weights: NDArray[np.float64], q: float) -> float:
    """Least value at or below which at least a share q of the weight lies."""
    order = np.argsort(values, kind="stable")
    share = np.cumsum(weights[order])
    index = int(np.searchsorted(share, q * share[-1] * (1.0 - 1e-12)))
    return float(values[order][min(index, len(order) - 1)])
