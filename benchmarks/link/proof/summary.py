"""Summary of many evaluated deliveries."""

from __future__ import annotations

import math
from collections import Counter
from statistics import fmean, median, pstdev
from typing import TYPE_CHECKING

from skyway.link.supervisor.proof.evidence import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator

    from benchmarks.link.proof.run import Run

ABOARD = {"stuck": 1.0, "silent": 1.0, "jammed": 1.0, "half": 0.5}
"""Share of the package that is on board after the release."""


def summary(runs: list[Run]) -> Iterator[str]:
    """Yield the lines of the summary."""
    good, bad = [run for run in runs if not run.failure], [run for run in runs if run.failure]
    alarms = [run for run in good if run.verdict != Verdict.DELIVERED]
    missed = [run for run in bad if run.verdict == Verdict.DELIVERED]
    shares = Counter((run.autopilot, "winch" if run.winch else "gripper") for run in good)
    yield f"{len(good)} good deliveries {dict(shares)}: {len(alarms)} not reported as delivered {dict(Counter(run.verdict for run in alarms))}"
    if good:
        yield f"  share of false alarms, 95 % bound: {100 * _most(len(alarms), len(good)):.2f} %"
    yield f"  lost by the power in flight, overruled or not: {sum(run.alarmed_s is not None for run in good)}"
    yield f"{len(bad)} failures: {len(missed)} missed"
    if bad:
        yield f"  share missed, 95 % bound: {100 * _most(len(missed), len(bad)):.2f} %"
    for (failure, pilot, verdict), count in sorted(
        Counter((run.failure, run.autopilot, run.verdict) for run in bad).items()
    ):
        yield f"  {failure:7} {pilot:9} {verdict}: {count}"
    after = [
        run.alarmed_s - run.lost_after_s for run in bad if run.alarmed_s is not None and run.lost_after_s is not None
    ]
    lost = sum(run.lost_after_s is not None for run in bad)
    if after:
        yield f"  lost on the way: {len(after)} of {lost} reported in flight, {max(after):.0f} s after the loss at the latest, {min(after):.0f} s at the earliest"
    yield from _weighed(runs)
    yield f"known at the latest {max((run.after_s for run in runs), default=0.0):.1f} s after the take-off"
    for run in (*alarms[:20], *missed[:20]):
        yield f"  {run}"


def _most(found: int, of: int) -> float:
    """Largest share for which at most `found` of `of` occur with a probability of 5 % (Clopper and Pearson)."""
    low, high = 0.0, 1.0
    for _ in range(50):
        share = (low + high) / 2.0
        below = sum(math.comb(of, k) * share**k * (1.0 - share) ** (of - k) for k in range(found + 1))
        low, high = (share, high) if below > 0.05 else (low, share)
    return high


def _weighed(runs: list[Run]) -> Iterator[str]:
    """Compare the weighings with the true share on board."""
    kinds = (
        ("before the release", [(one.before, 1.0) for one in runs if one.failure != "early"]),
        ("after it", [(one.after, ABOARD.get(one.failure, 0.0)) for one in runs if one.failure != "early"]),
    )
    for name, pairs in kinds:
        known = [(found[0], found[1], (found[0] - true) / found[1]) for found, true in pairs if found is not None]
        if len(known) > 1:
            off, sigmas, z = [one[0] for one in known], [one[1] for one in known], [one[2] for one in known]
            yield (
                f"weighed {name}, of {len(pairs)}: {len(known)}; off by {fmean(z):+.2f} standard deviations, {pstdev(z):.2f} of scatter, at most "
                f"{max(map(abs, z)):.1f}; within two of them {sum(abs(one) < 2.0 for one in z) / len(z):.1%}; shares {min(off):.2f} to {max(off):.2f}, "
                f"standard deviation {median(sigmas):.2f}"
            )
