"""Loads of the pads for benchmarks and tests: a profile scaled to a utilisation."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from skyway.models.queues.load import PadLoad


def scaled_to(load: PadLoad, utilisation: float, pads: ArrayLike) -> PadLoad:
    """Scale the arrivals so that the mean utilisation of each station over the week is the given one.

    A station where nobody arrives has no profile to scale and gets the same arrivals in every hour; a station without pads
    stays without load.
    """
    count = np.broadcast_to(np.asarray(pads, dtype=np.float64), (len(load),))[:, None]
    offered = load.arrivals_per_s * load.mean_charging_s
    idle = ~np.any(offered > 0.0, axis=1, keepdims=True)
    shape = np.where(idle, 1.0 / load.mean_charging_s, load.arrivals_per_s)
    mean_offered = np.mean(np.where(idle, 1.0, offered), axis=1, keepdims=True)
    factor = np.where(count > 0.0, utilisation * count / mean_offered, 0.0)
    return replace(load, arrivals_per_s=shape * factor)
