"""Parameters of the paper's planners."""

from __future__ import annotations

from dataclasses import dataclass

from skyway.models.base.parameters import Parameters, parameter


@dataclass(frozen=True)
class PfsParameters(Parameters):
    """Of `pfs` and its variants."""

    strict_steps: int = parameter(
        4, "`pfs-strict` gives up after this many steps for each station of the network", 1, 10**6,
        measured="chosen, not measured: Algorithm 1 as printed may run in circles",
    )  # fmt: skip
    kept_flights: int = parameter(
        100_000_000, "maximum number of stored flights, by segment and slot", 0, 10**12,
        measured="memory: larger networks are computed each time",
    )  # fmt: skip


@dataclass(frozen=True)
class IesParameters(Parameters):
    """Of `ies`."""

    gain_s: float = parameter(
        1e-6, "only compositions that are better by this much are searched", 0, 3600, unit="s",
        measured="chosen, not measured: above the rounding of instants, 2.4e-7 s",
    )  # fmt: skip
