"""Proof of one delivery: evidence collected as the drone flies, journaled, and judged."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, tzinfo
from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import Proved
from skyway.link.supervisor.proof.evidence import Evidence, Verdict, judge
from skyway.link.supervisor.proof.scale_of import scale_of
from skyway.link.supervisor.proof.weighing import END_S, Scale, Weight

if TYPE_CHECKING:
    from collections.abc import Iterable

    from skyway.link.supervisor.context import Context
    from skyway.link.supervisor.journal.file import Record
    from skyway.models.drones.telemetry import TelemetrySample

_OFF_GROUND_M, _DOWN = 0.5, 1.0


@dataclass(slots=True)
class Proof:
    """The evidence of one delivery; written only by its own methods."""

    evidence: Evidence = field(default_factory=Evidence)
    zone: tzinfo = UTC
    """Of the times in the reasons."""
    _scale: Scale | None = None
    _gains: list[float] = field(default_factory=list)
    _down: bool = True
    _releasing: bool = False
    """The drone hovers to release the package: power falls when that stands on the ground."""
    _unwatched: bool = False
    """A release, or its beginning, happened while this program did not run: how long the package hung is unknown."""
    _open: bool = False
    """A take-off is being weighed."""

    @property
    def verdict(self) -> tuple[Verdict, str]:
        """Return whether the package was delivered, as far as is known, and the evidence."""
        return judge(self.evidence, self.zone)

    @property
    def lost(self) -> bool:
        """Whether the package left the drone on the way."""
        return self.evidence.lost

    def hear(self, ctx: Context, s: TelemetrySample) -> None:
        """Weigh by a sample of the flight; report and journal the result."""
        if not ctx.job.request.payload_kg > 0.0:
            return
        if self._scale is None:
            drone = ctx.job.scenario.drone(ctx.job.request.drone or "")
            self._scale = scale_of(drone, ctx.job.request.payload_kg, ctx.job.drag)
            self._scale.remember(self._gains)
            if self.evidence.tried:  # before the program was restarted
                self._scale.may_be_empty()
        down = s.landed == _DOWN or s.armed == 0.0
        if self._down and not down and s.height_m > _OFF_GROUND_M:
            self._scale.take_off(s.time_s)
            if self._unwatched:
                self._scale.may_hang()
            self._down, self._open = False, True
        elif down:
            if self._open:  # it was in the air for a few seconds, or has hovered there
                self._weighed(ctx, self._scale)
            self._down, self._open = True, False
        if self._down:
            return
        self._scale.hear(s, ctx.wind.here(s))
        if not (self.evidence.tried or self._releasing):
            self._watch_loss(ctx, self._scale)
        if self._open and s.time_s > self._scale.took_off_s + END_S:
            self._open = False
            self._weighed(ctx, self._scale)

    def _weighed(self, ctx: Context, scale: Scale) -> None:
        """Use the weighing of a take-off: with the package it is a reference for later ones, without it the proof."""
        if self.lost:
            return
        if not self.evidence.tried:
            gain = scale.gain()
            if gain is not None:
                ctx.note(
                    Proved(gain_w=gain),
                    f"power of this take-off with the package: {gain:.0f} W by the model of the scale",
                )
            return
        self._take(ctx, replace(self.evidence, weight=scale.weigh()))

    def _watch_loss(self, ctx: Context, scale: Scale) -> None:
        if self.lost:
            return
        lost_s = scale.lost()
        if lost_s is not None:
            self._take(ctx, replace(self.evidence, lost_s=lost_s))

    def released(self, ctx: Context, *, acknowledged: bool | None, by_person: bool = False, how: str = "") -> None:
        """Record the release as reported by the gripper, the winch or the person; `how` is the observation of a release in the air."""
        kg = ctx.job.request.payload_kg
        if self._scale is not None:
            self._scale.may_be_empty()
        self._take(ctx, replace(self.evidence, acknowledged=acknowledged, by_person=by_person, how=how, package_kg=kg))

    def before_release(self, ctx: Context) -> None:
        """Weigh the package on board just before its release."""
        found = None if self._scale is None else self._scale.before_release(self.evidence.lost_s)
        if found is not None:
            self._take(ctx, replace(self.evidence, before=found, package_kg=ctx.job.request.payload_kg))

    def begins_release(self, *, watched: bool) -> None:
        """Record the beginning of a hover for the release; `watched`: observed from its beginning."""
        self._releasing, self._unwatched = True, not watched
        if self._unwatched and self._scale is not None:
            self._scale.may_hang()

    def leaves(self, ctx: Context, *, hovered: bool) -> None:
        """Record the departure from the place of the release: weigh from now on; and by the hover, if the drone only hovered there."""
        if self._scale is not None:
            self._scale.leave(ctx.now_s, hovered=hovered)
            self._open = True

    def _take(self, ctx: Context, evidence: Evidence) -> None:
        before = judge(self.evidence)[0] if self.evidence.tried or self.lost else None
        self.evidence = evidence
        verdict, reason = judge(evidence, self.zone)
        b, w = evidence.before, evidence.weight
        entry = Proved(
            verdict=str(verdict), acknowledged=evidence.acknowledged, by_person=evidence.by_person or None,
            how=evidence.how or None, lost_s=evidence.lost_s,
            before=None if b is None else b.share, before_sigma=None if b is None else b.sigma,
            share=None if w is None else w.share, sigma=None if w is None else w.sigma,
        )  # fmt: skip
        ctx.note(entry, f"proof of delivery: {verdict}: {reason}")
        if (verdict is not before or w is not None) and (evidence.tried or evidence.lost):
            ctx.tell(f"proof of delivery: {verdict}: {reason}")

    def restore(self, records: Iterable[Record], package_kg: float) -> None:
        """Restore the evidence from a journal."""
        for record in records:
            entry = record.entry(Proved)
            if entry is None:
                continue
            if entry.gain_w is not None:
                self._gains.append(entry.gain_w)
                continue
            self.evidence = Evidence(
                entry.acknowledged, bool(entry.by_person), entry.how or "", entry.lost_s,
                _weight(entry.before, entry.before_sigma), _weight(entry.share, entry.sigma), package_kg,
            )  # fmt: skip


def _weight(share: float | None, sigma: float | None) -> Weight | None:
    return None if share is None or sigma is None else Weight(share, sigma, 0)
