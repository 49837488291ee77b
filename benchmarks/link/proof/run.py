"""One delivery of the evaluation: the inputs of its proof, and the verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

from skyway.link.supervisor.proof.proof import Proof
from skyway.models.drones.drone import M200_V2

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context
    from skyway.models.drones.drag import DragModel
    from skyway.models.drones.telemetry import TelemetrySample


@dataclass(frozen=True)
class Run:
    """Result of one delivery."""

    seed: int
    autopilot: str
    winch: bool
    failure: str
    verdict: str
    reason: str
    after_s: float
    """Time of the result after the second take-off, s; 0 if it was known before."""
    alarmed_s: float | None
    """Time after the take-off at which, before the release, the power fell as if the package was lost, s; None if it did not."""
    lost_after_s: float | None
    """Time of the true loss after the take-off, s; None if it was not lost."""
    package_kg: float = 0.0
    before: tuple[float, float] | None = None
    after: tuple[float, float] | None = None
    """`before`, `after`: share of the package that was weighed before and after the release, and its standard deviation."""


@dataclass
class Heard:
    """All inputs of the proof of one delivery, in order: sufficient to evaluate it again."""

    seed: int
    autopilot: str
    winch: bool
    failure: str
    package_kg: float
    lost_after_s: float | None = None
    drag: DragModel | None = None
    events: list[tuple[Any, ...]] = field(default_factory=list)


class Judged:
    """The supervisor's proof of one delivery, and its inputs."""

    def __init__(self, heard: Heard) -> None:
        self.heard = heard
        self.proof = Proof()
        self.air = (0.0, 0.0)
        self.now_s = math.nan
        self.took_off_s = math.nan
        self.left_s = math.nan
        self.known_s = math.nan
        self.alarmed_s: float | None = None
        request = SimpleNamespace(payload_kg=heard.package_kg, drone=M200_V2.name)
        scenario = SimpleNamespace(drone=lambda _: M200_V2)
        silent = lambda *_: None  # noqa: E731
        self.context = cast(
            "Context",
            SimpleNamespace(
                job=SimpleNamespace(request=request, scenario=scenario, drag=heard.drag),
                wind=SimpleNamespace(here=lambda _: self.air), note=silent, tell=silent, now_s=0.0,
            ),
        )  # fmt: skip

    def hear(self, s: TelemetrySample, air: tuple[float, float]) -> None:
        """Take a sample, and the estimated wind."""
        self.heard.events.append(("hear", s, air))
        self._hear(s, air)

    def _hear(self, s: TelemetrySample, air: tuple[float, float]) -> None:
        self.air, self.now_s = air, s.time_s
        self.proof.hear(self.context, s)
        tried, e = self.proof.evidence.tried, self.proof.evidence
        if s.height_m > 0.5 and math.isnan(self.left_s if tried else self.took_off_s):
            if tried:
                self.left_s = s.time_s
            else:
                self.took_off_s = s.time_s
        if e.lost_s is not None and self.alarmed_s is None:
            self.alarmed_s = s.time_s - self.took_off_s
        if e.weight is not None and math.isnan(self.known_s):
            self.known_s = s.time_s

    def tell(self, what: str, **how: Any) -> None:
        """Pass another event to the proof: `before_release`, `begins_release`, `released` or `leaves`."""
        self.heard.events.append((what, how))
        self._tell(what, how)

    def _tell(self, what: str, how: dict[str, Any]) -> None:
        self.context.now_s = self.now_s  # type: ignore[misc]
        arguments = () if what == "begins_release" else (self.context,)
        getattr(self.proof, what)(*arguments, **how)
        if what == "leaves":
            self.left_s = self.now_s

    def again(self) -> Run:
        """Evaluate the stored inputs again."""
        for what, *rest in self.heard.events:
            if what == "hear":
                self._hear(*rest)
            else:
                self._tell(what, *rest)
        return self.run()

    def run(self) -> Run:
        """Return the result."""
        verdict, reason = self.proof.verdict
        h, known = self.heard, self.proof.lost or self.proof.evidence.acknowledged is False
        after_s = 0.0 if known else self.known_s - self.left_s
        e = self.proof.evidence
        before, after = (None if one is None else (one.share, one.sigma) for one in (e.before, e.weight))
        return Run(
            h.seed, h.autopilot, h.winch, h.failure, str(verdict), reason, after_s, self.alarmed_s, h.lost_after_s,
            h.package_kg, before, after,
        )  # fmt: skip
