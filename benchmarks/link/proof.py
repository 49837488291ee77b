"""Proof of delivery, judged by the simulator's own physics: good releases and injected failures, on both autopilots.

Each delivery: take-off under the package, a leg, landing, release, take-off again; every fifth by winch, in the air. The simulator's power and drag are
not those by which the package is weighed; each vehicle draws up to 5 % more or less than thought, wind and gusts blow, the wind shifts on the ground, and the
wind that the scale is told is off. What weighs and judges is the supervisor's own `Proof`, fed with what the link brings.

``python -m benchmarks.link.proof --good 1000 --bad 200``; with ``--heard FILE`` what was heard is kept, and ``--again FILE`` judges it once more, without
flying: so a change of the scale is judged in a minute. ``--ways N`` flies N long ways in gusts that begin and end at once, with the wind as it is believed in a
supervised flight, and counts what is told of a package lost on the way; in every second it is. ``--far N`` flies N far deliveries (`benchmarks.link.proof_far`): minutes
of cruise, strong wind that grows with height, speeds that are changed, packages of any weight, weak batteries; half of them fail.
"""

from __future__ import annotations

import argparse
import dataclasses
import gzip
import json
import math
import pickle
import random
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean, median, pstdev
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

from skyway.calibration_flight import drag_of
from skyway.link.protocol.connection import Connection
from skyway.link.supervisor.flight.release import HANGS_S, LINE_M
from skyway.link.supervisor.proof.evidence import Verdict
from skyway.link.supervisor.proof.proof import Proof
from skyway.link.vehicle.vehicle import Vehicle
from skyway.missions.builder.release_items import release_range
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.mission import Mission, MissionItem
from skyway.models.base.errors import LinkError
from skyway.models.composition.release import WINCH_HEIGHT_M, WINCH_SLACK_M, winch_s
from skyway.models.drones.drone import M200_V2
from skyway.models.wind.estimation.live import LiveWind
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.faults import Fault
from skyway.sim_stub.plant.wind_truth import ConstantWind
from skyway.sim_stub.transports.lockstep import Lockstep
from skyway.sim_stub.world import World

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from skyway.link.supervisor.context import Context
    from skyway.models.drones.drag import DragModel
    from skyway.models.drones.telemetry import TelemetrySample
    from skyway.sim_stub.plant.wind_truth import WindTruth

    Acts = Sequence[tuple[float, Callable[[], None]]]
    """What is done so many seconds after a take-off."""

LAT, LON, GROUND_M = 40.7392, -73.9756, 5.0
FAILURES = ("stuck", "early", "half", "silent", "jammed")
"""Acknowledged and not released; lost on the way; half of it released; the gripper does not move and says so; a winch that jams."""
WINCH_EVERY = 5
"""Every so manieth good delivery is by winch."""
HEIGHT_M, LEG_M = 45.0, 300.0
AFTER_S = 18.5
"""So long after a take-off the answer is to be there."""


@dataclass(frozen=True)
class Run:
    """One delivery that was judged."""

    seed: int
    autopilot: str
    winch: bool
    failure: str
    verdict: str
    reason: str
    after_s: float
    """After the second take-off; 0 where it was known before."""
    alarmed_s: float | None
    """In flight, before the release, the power fell as if the package were lost: so many seconds after the take-off."""
    lost_after_s: float | None
    """It was lost so many seconds after the take-off."""
    package_kg: float = 0.0
    before: tuple[float, float] | None = None
    after: tuple[float, float] | None = None
    """`before`, `after`: share of the package that was weighed before and after the release, and its standard deviation."""


@dataclass
class Heard:
    """All that a proof hears of one delivery, in order: enough to judge it once more."""

    seed: int
    autopilot: str
    winch: bool
    failure: str
    package_kg: float
    lost_after_s: float | None = None
    drag: DragModel | None = None
    events: list[tuple[Any, ...]] = field(default_factory=list)


class Judged:
    """The supervisor's proof of one delivery, and what it was told."""

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
        """Take a sample, and the wind that is believed."""
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
        """Tell the proof what else happens: `before_release`, `begins_release`, `released` or `leaves`."""
        self.heard.events.append((what, how))
        self._tell(what, how)

    def _tell(self, what: str, how: dict[str, Any]) -> None:
        self.context.now_s = self.now_s  # type: ignore[misc]
        arguments = () if what == "begins_release" else (self.context,)
        getattr(self.proof, what)(*arguments, **how)
        if what == "leaves":
            self.left_s = self.now_s

    def again(self) -> Run:
        """Judge what was heard."""
        for what, *rest in self.heard.events:
            if what == "hear":
                self._hear(*rest)
            else:
                self._tell(what, *rest)
        return self.run()

    def run(self) -> Run:
        """What became of it."""
        verdict, reason = self.proof.verdict
        h, known = self.heard, self.proof.lost or self.proof.evidence.acknowledged is False
        after_s = 0.0 if known else self.known_s - self.left_s
        e = self.proof.evidence
        before, after = (None if one is None else (one.share, one.sigma) for one in (e.before, e.weight))
        return Run(
            h.seed, h.autopilot, h.winch, h.failure, str(verdict), reason, after_s, self.alarmed_s, h.lost_after_s,
            h.package_kg, before, after,
        )  # fmt: skip


WAY_M, WAY_GUSTS = 4500.0, 7
"""A long way, and how many gusts blow on it."""


def leg(north_m: float, *, back: bool = False) -> Mission:
    """Up, so far north, or back from there, and down."""
    ends = [LAT, LAT + north_m / 111_000.0]
    begin, end = (round(one * 1e7) for one in (reversed(ends) if back else ends))
    y = round(LON * 1e7)

    def item(command: Command, x: int, z: float) -> MissionItem:
        return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, x=x, y=y, z=z, param4=math.nan)

    up, over = item(Command.NAV_TAKEOFF, begin, HEIGHT_M), item(Command.NAV_WAYPOINT, end, HEIGHT_M)
    return Mission((up, over, item(Command.NAV_LAND, end, 0.0)))


def _lowering(north_m: float, *, back: bool) -> Mission:
    """Out, hover, line out and in, and on the way back."""
    out = leg(north_m, back=back).items
    over = out[1]
    hover = dataclasses.replace(over, z=WINCH_HEIGHT_M)
    wait = dataclasses.replace(hover, command=Command.NAV_LOITER_TIME, param1=winch_s(), param4=0.0)
    length_m = WINCH_HEIGHT_M + WINCH_SLACK_M
    down, up = (MissionItem(Command.DO_WINCH, Frame.MISSION, 1.0, 1.0, metres, 1.0) for metres in (length_m, -length_m))
    return Mission((*out[:2], hover, down, wait, up, wait, over, *leg(north_m, back=not back).items[1:]))


class Stage:
    """One vehicle with its package, and the proof of its delivery."""

    def __init__(
        self,
        heard: Heard,
        *,
        gusts: int = 0,
        over_s: float = 60.0,
        wind: WindTruth | None = None,
        parameters: tuple[tuple[str, float], ...] = (),
    ) -> None:
        seed, autopilot, failure = heard.seed, heard.autopilot, heard.failure
        self.rng = rng = random.Random(f"{'winch/' if heard.winch else ''}{seed}/{autopilot}/{failure}")
        wind_mps, towards = rng.uniform(0.0, 9.0), rng.uniform(0.0, 360.0)
        faults = () if heard.drag else _faults(failure, rng)
        heard.lost_after_s = faults[0].start_s if faults and failure == "early" else None
        ardupilot = (("GRIP_ENABLE", 1.0), ("WINCH_TYPE", float(rng.choice((1, 2)))))
        gripper = ardupilot if autopilot == "ardupilot" else (("PD_GRIPPER_EN", 1.0),)
        self.off = rng.gauss(0.0, 0.8), rng.gauss(0.0, 0.8)
        """Error of the wind that the scale is told, (north, east), m/s."""
        for _ in range(gusts):
            begins_s = rng.uniform(5.0, over_s)
            gust = Fault(
                "gust", begins_s, begins_s + rng.uniform(8.0, 60.0), rng.uniform(3.0, 9.0), after_take_off=True
            )
            faults = (*faults, gust)
        blows = wind or ConstantWind.of(wind_mps, towards)
        self.world = World(wind=blows, faults=faults)
        self.craft = self.world.add(
            VehicleConfig(
                lat=LAT, lon=LON, ground_m=GROUND_M, autopilot=autopilot, seed=seed, warm=True,
                payload_kg=heard.package_kg, parameters=(*gripper, *parameters),
            )
        )  # fmt: skip
        lockstep = Lockstep(self.world)
        self.connection = Connection(lockstep.connect(self.craft, seed=seed), lockstep.clock)
        self.vehicle = Vehicle(self.connection)
        self.vehicle.request_telemetry()
        self.judged = Judged(heard)
        self.releasing = False
        """It hovers where it lowers the package."""
        self.wind: LiveWind | None = None
        """Believes the wind as a supervised flight does; None tells the true one, a little off."""
        if heard.drag is not None:
            north, east = blows.at(0.0, LAT, LON, HEIGHT_M)
            told = north + 2.0 * self.off[0], east + 2.0 * self.off[1]
            self.wind = LiveWind(drag=heard.drag, forecast=lambda *_: told)

    def _air(self, s: TelemetrySample) -> tuple[float, float]:
        if self.wind is None:
            north, east = self.craft.true_wind
            return north + self.off[0], east + self.off[1]
        if s.landed == 0.0 and s.height_m > 0.6 * HEIGHT_M:
            self.wind.hear(s)
        now = self.wind.estimate
        return (0.0, 0.0) if now is None or now.source == "inconsistent" else (now.north_mps, now.east_mps)

    def _samples(self, seconds: float) -> Iterator[TelemetrySample]:
        for s in self.vehicle.samples(seconds):
            self.judged.hear(s, self._air(s))
            yield s

    def lower(self, north_m: float = LEG_M, acts: Acts = (), *, back: bool = False) -> None:
        """Fly out, lower the package and leave; ends when the answer is due."""
        vehicle, clock, judged = self.vehicle, self.connection.clock, self.judged
        mission = _lowering(north_m, back=back)
        assert vehicle.upload(mission).verified
        vehicle.start(60.0)
        first, last = release_range(mission.items) or (0, 0)
        begun_s, line_m, asked, weighed = math.nan, None, False, False
        end, due, set_off_s = clock.now_s() + 3600.0, list(acts), math.nan
        while clock.now_s() < end:
            self._act(due, set_off_s)
            if math.isnan(set_off_s) and self.craft.body.up_mps > 0.3:
                set_off_s = judged.now_s
            for s in self._samples(0.5):
                if s.time_s > judged.left_s + AFTER_S:
                    return
            said = vehicle.peer.latest.get("MISSION_CURRENT")
            item = -1 if said is None else said["seq"] - vehicle.family.home_items
            if math.isnan(begun_s) and item >= first:
                begun_s, self.releasing = clock.now_s(), True
                judged.tell("begins_release", watched=True)
            if not weighed and clock.now_s() > begun_s + HANGS_S:
                judged.tell("before_release")
                weighed = True
            if not asked and clock.now_s() > begun_s + winch_s() - 5.0:
                line_m, asked = vehicle.winch_line_m(), True
            if math.isnan(judged.left_s) and item > last:
                told = None if line_m is None else line_m >= WINCH_HEIGHT_M - LINE_M
                judged.tell("released", acknowledged=told, how="the winch")
                judged.tell("leaves", hovered=True)
        raise RuntimeError("it did not leave")

    def _act(self, due: list[tuple[float, Callable[[], None]]], took_off_s: float) -> None:
        """Do what is due so long after a take-off."""
        while due and self.judged.now_s > took_off_s + due[0][0]:
            due.pop(0)[1]()

    def fly(self, mission: Mission, until_s: float = math.inf, acts: Acts = ()) -> None:
        """Fly until it stands, or so long after its take-off; `acts` in the order of time."""
        vehicle, clock = self.vehicle, self.connection.clock
        assert vehicle.upload(mission).verified
        vehicle.start(60.0)
        took_off_s, end, due = math.nan, clock.now_s() + 3600.0, list(acts)
        while clock.now_s() < end:
            self._act(due, took_off_s)
            for s in self._samples(0.5):
                if math.isnan(took_off_s) and s.height_m > 0.3:
                    took_off_s = s.time_s
                if s.time_s > took_off_s + until_s:
                    return
            if not math.isnan(took_off_s) and not vehicle.armed:
                return
        raise RuntimeError("it did not land")

    def let_go(self, north_m: float = LEG_M, acts: Acts = (), *, back: bool = False) -> None:
        """Fly out, land, let the package go, and begin the way back."""
        self.fly(leg(north_m, back=back), acts=acts)
        self.judged.tell("before_release")
        self.connection.run_for(20.0)
        if self.rng.random() < 0.5:  # other wind when it leaves
            self.craft.faults.add(Fault("wind-shift", value=self.rng.uniform(0.0, 4.0)), self.world.sim_s)
        acknowledged = True
        try:
            self.vehicle.release()
        except LinkError:
            acknowledged = False
        self.judged.tell("released", acknowledged=acknowledged)
        if acknowledged:
            self.fly(leg(north_m, back=not back), until_s=AFTER_S)


def _faults(failure: str, rng: random.Random) -> tuple[Fault, ...]:
    if failure in ("stuck", "half"):
        return (Fault("gripper-stuck", value=1.0 if failure == "stuck" else 0.5),)
    if failure == "jammed":
        return (Fault("winch-jammed", value=rng.uniform(0.5, 12.0)),)
    if failure == "silent":
        return (Fault("gripper-silent"),)
    if failure == "early":
        return (Fault("package-lost", start_s=rng.uniform(24.0, 64.0), value=1.0, after_take_off=True),)
    return ()


def deliver(
    seed: int, autopilot: str, failure: str = "", package_kg: float = 0.8, *, winch: bool = False, gusts: bool = False
) -> tuple[Run, Heard]:
    """Fly one delivery, and judge it; `gusts` puts one that begins at once on the way."""
    heard = Heard(seed, autopilot, winch or failure == "jammed", failure, package_kg)
    stage = Stage(heard, gusts=int(gusts))
    if heard.winch:
        stage.lower()
    else:
        stage.let_go()
    return stage.judged.run(), heard


def way(seed: int, autopilot: str, failure: str = "") -> tuple[Run, Heard]:
    """Fly a long way in gusts, with a package of any weight, which may be lost on it."""
    luck = random.Random(f"way/{seed}")
    package_kg = round(luck.uniform(0.2, 1.2), 2)
    heard = Heard(seed, autopilot, winch=False, failure=failure, package_kg=package_kg, drag=drag_of(M200_V2, 0.8))
    stage = Stage(heard, gusts=WAY_GUSTS, over_s=WAY_M / 12.0)
    if failure:
        heard.lost_after_s = luck.uniform(30.0, WAY_M / 15.0)
        stage.craft.faults.add(Fault("package-lost", heard.lost_after_s, value=1.0, after_take_off=True), 0.0)
    stage.fly(leg(WAY_M), until_s=WAY_M / 12.0)
    return stage.judged.run(), heard


def _way(case: tuple[int, str, str, bool, bool]) -> tuple[Run, Heard]:
    return way(*case[:3])


def _far(case: tuple[int, str, str, bool, bool]) -> tuple[Run, Heard]:
    from benchmarks.link.proof_far import far  # it is made of what is here

    return far(*case[:3])


def _one(case: tuple[int, str, str, bool, bool]) -> tuple[Run, Heard]:
    seed, autopilot, failure, winch, gusts = case
    return deliver(seed, autopilot, failure, winch=winch, gusts=gusts)


def _again(file: Path) -> Iterator[tuple[Run, Heard]]:
    with gzip.open(file) as stream:
        while True:
            try:
                heard = pickle.load(stream)
            except EOFError:
                return
            yield Judged(heard).again(), heard


def _most(found: int, of: int) -> float:
    """Largest share that would show at most so many of so many with a probability of 5 % (Clopper and Pearson)."""
    low, high = 0.0, 1.0
    for _ in range(50):
        share = (low + high) / 2.0
        below = sum(math.comb(of, k) * share**k * (1.0 - share) ** (of - k) for k in range(found + 1))
        low, high = (share, high) if below > 0.05 else (low, share)
    return high


def tell(runs: list[Run]) -> Iterator[str]:
    """Tell many in a few lines."""
    good, bad = [run for run in runs if not run.failure], [run for run in runs if run.failure]
    alarms = [run for run in good if run.verdict != Verdict.DELIVERED]
    missed = [run for run in bad if run.verdict == Verdict.DELIVERED]
    shares = Counter((run.autopilot, "winch" if run.winch else "gripper") for run in good)
    yield f"{len(good)} good deliveries {dict(shares)}: {len(alarms)} not told delivered {dict(Counter(run.verdict for run in alarms))}"
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
        yield f"  lost on the way: {len(after)} of {lost} told in flight, {max(after):.0f} s after the loss at the latest, {min(after):.0f} s at the earliest"
    yield from _weighed(runs)
    yield f"known at the latest {max((run.after_s for run in runs), default=0.0):.1f} s after the take-off"
    for run in (*alarms[:20], *missed[:20]):
        yield f"  {run}"


ABOARD = {"stuck": 1.0, "silent": 1.0, "jammed": 1.0, "half": 0.5}
"""Share of the package that is aboard after the release."""


def _weighed(runs: list[Run]) -> Iterator[str]:
    """How well what was weighed agrees with what was aboard."""
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


def main() -> None:
    """Fly them all, and count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--good", type=int, default=100)
    parser.add_argument("--bad", type=int, default=40)
    parser.add_argument("--first", type=int, default=10_000)
    parser.add_argument("--gusts", action="store_true", help="with a gust that begins at once")
    parser.add_argument("--ways", type=int, default=0, help="so many long ways instead, half of them with a loss")
    parser.add_argument("--far", type=int, default=0, help="so many far deliveries instead, half of them fail")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--output", type=Path, default=Path("out/proof.jsonl"), help="each run, as soon as it is judged"
    )
    parser.add_argument("--heard", type=Path, help="keep all that was heard in this file")
    parser.add_argument("--again", type=Path, nargs="+", help="judge what such files hold once more, and fly nothing")
    given = parser.parse_args()
    pilots = ("px4", "ardupilot")
    cases = [(given.first + n, pilots[n % 2], "", n // 2 % WINCH_EVERY == 0, given.gusts) for n in range(given.good)]
    cases += [
        (
            given.first + n,
            pilots[n % 2],
            failure,
            failure in ("early", "half") and n // 10 % WINCH_EVERY == 0,
            given.gusts,
        )
        for n in range(given.bad)
        for failure in [FAILURES[n // 2 % len(FAILURES)]]
    ]
    if given.ways:
        cases = [(given.first + n, pilots[n % 2], ("", "early")[n // 2 % 2], False, False) for n in range(given.ways)]
    if given.far:
        cases = [
            (given.first + n, pilots[n % 2], ("", FAILURES[n // 4 % len(FAILURES)])[n // 2 % 2], False, False)
            for n in range(given.far)
        ]
    random.Random(0).shuffle(cases)  # so that a run that is stopped has some of all
    given.output.parent.mkdir(parents=True, exist_ok=True)
    runs = []

    def keep(found: Iterable[tuple[Run, Heard]]) -> None:
        with (
            gzip.open(given.heard, "wb", compresslevel=1) if given.heard else nullcontext() as kept,
            given.output.open("w", encoding="utf-8") as file,
        ):
            for run, heard in found:
                runs.append(run)
                file.write(json.dumps(dataclasses.asdict(run)) + "\n")
                file.flush()
                if kept is not None:
                    pickle.dump(heard, kept)

    if given.again:
        keep(one for file in given.again for one in _again(file))
    else:
        with ProcessPoolExecutor(given.workers) as pool:
            flown = _way if given.ways else _far if given.far else _one
            keep(pool.map(flown, cases, chunksize=4))
    print(*tell(runs), sep="\n")


if __name__ == "__main__":
    main()
