"""Supervised deliveries through faults, and the same plans flown blindly: ``python -m benchmarks.link.supervision --seeds 300``.

Every seed is another delivery: autopilot, day, hour, way, package, and what goes wrong. The days are those of the record whose
ordinal leaves 5 when divided by 7; nothing else in the project uses them as a set (while supervision was made, those that leave 3
were looked at), and each is left out of the record that its delivery is planned with. The planner is the one that people get who name none. With ``--forecast``
a delivery is planned with what a weather service of realistic error says (`benchmarks.cases.day_forecast`), issued up to two hours before.
"""

from __future__ import annotations

import argparse
import json
import random
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from datetime import UTC, date, datetime, timedelta
from datetime import time as daytime
from functools import cache
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np

from benchmarks.cases.day_forecast import DayForecasts, rest_by_lead
from benchmarks.independent.product import planning
from benchmarks.link.deliveries import Scripted, Stage, Story, newyork
from skyway.link.supervisor import read_journal
from skyway.models.base import geodesy
from skyway.models.base.errors import InfeasibleError, InputError
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.registry import ROBUST
from skyway.sim_stub.faults import parse_fault
from skyway.sim_stub.transports.channel import Impairment

LOCAL = ZoneInfo("America/New_York")
NEAR_M, FAR_M = 9_000.0, 22_000.0
GO_AFTER_S = 45.0
REMAINDER, OTHER_REMAINDER = 5, 2
"""Of the ordinals of days, divided by 7: those that are flown on, and those of which the weather service is made."""
CITY = "new-york"


@dataclass(frozen=True)
class Told:
    """What became of one delivery."""

    seed: int
    autopilot: str
    supervised: bool
    faults: tuple[str, ...]
    state: str
    reason: str
    station: str | None
    true_station: str | None
    crashed: bool
    flights: int
    delivery_s: float | None
    lowest_soc: float
    replans: int
    diverts: int
    wall_s: float

    @property
    def failed(self) -> bool:
        """Stranded, crashed, or standing away from a station."""
        return self.crashed or self.true_station is None or self.state not in ("delivered", "stopped-safe")


@cache
def days() -> list[date]:
    """Days of 2013 that nothing else uses as a set."""
    first = date(2013, 1, 6)
    found = [day for day in (first + timedelta(days=n) for n in range(350)) if day.toordinal() % 7 == REMAINDER]
    return [day for day in found if _is_whole(day)]


def _is_whole(day: date) -> bool:
    """Whether the record has all of a day and the next one."""
    begins = datetime.combine(day, daytime(0), LOCAL)
    try:
        newyork().truth(day, begins, HORIZON_H)
    except InputError:
        return False
    return True


@cache
def service() -> DayForecasts:
    """A weather service, its error measured on days that nothing here is flown on."""
    sites = planning.city(CITY).sites
    first = datetime(2013, 1, 10, tzinfo=UTC)
    learnt = [day for day in (first + timedelta(days=n) for n in range(340)) if day.toordinal() % 7 == OTHER_REMAINDER]
    return DayForecasts(sites, rest_by_lead(sites, [day.timestamp() for day in learnt]))


def story_of(seed: int, *, reports: bool = False, answers: Path | None = None) -> tuple[Story, tuple[str, ...]]:
    """One delivery with its faults; `answers`: it is planned with a forecast, whose files are put into this folder."""
    luck = random.Random(f"supervision/{seed}")
    scenario = newyork()
    stations = [s for s in scenario.network.stations if s.pads > 0]
    while True:
        start, to = luck.sample(stations, 2)
        away = geodesy.distance_m(start.lat, start.lon, to.lat, to.lon)
        if NEAR_M <= away <= FAR_M:
            break
    depart = datetime.combine(luck.choice(days()), daytime(luck.randrange(8, 17)), LOCAL)
    faults = [f"gust={luck.uniform(3, 7):.1f}@{luck.randrange(60, 1200)}s+{luck.randrange(10, 90)}s"]
    for chance, text in (
        (0.35, "battery-weak=0.9"),
        (0.35, f"pads-taken@{luck.randrange(0, 1800)}s+{luck.randrange(20, 60)}m"),
        (0.4, f"link-loss@{luck.randrange(20, 1500)}s+{luck.randrange(5, 60)}s"),
        (0.25, f"gps-glitch@{luck.randrange(60, 1200)}s"),
        (0.2, f"pilot@{luck.randrange(60, 900)}s"),
        (0.25, f"wind-shift={luck.uniform(1, 4):.1f}@{luck.randrange(60, 1800)}s"),
    ):
        if luck.random() < chance:
            faults.append(text)
    lossy = luck.random() < 0.3
    story = Story(
        autopilot=("px4", "ardupilot")[seed % 2],
        start=start.id,
        to=to.id,
        depart=depart.isoformat(),
        payload_kg=round(luck.uniform(0.2, 1.2), 2),
        seed=seed,
        faults=tuple(parse_fault(text) for text in faults),
        impairment=Impairment(0.2, 0.02, 0.005, 0.02, 0.02) if lossy else None,
        planner=ROBUST,
        reports=reports,
        held_out=True,
        weather=() if answers is None else (service().newest(answers, depart.timestamp()),),
    )
    return story, (*faults, *(["upload-loss=0.2"] if lossy else []))


def tell(seed: int, folder: Path, *, supervised: bool, reports: bool = False, forecast: bool = False) -> Told | None:
    """Fly one; None where there is no plan."""
    story, faults = story_of(seed, reports=reports, answers=folder if forecast else None)
    try:
        stage = Stage(replace(story, supervised=supervised), folder)
    except InfeasibleError:
        return None
    stage.operator = Scripted(
        lambda question, _: (GO_AFTER_S, "go") if "nothing is commanded" in question else (0.0, "yes"),
        stage.lockstep.clock.now_s,
    )
    begun = time.perf_counter()
    lowest = [1.0]

    def watch(ctx: object) -> None:  # noqa: ARG001
        if stage.craft.body.grounded and stage.craft.charging is None:
            lowest[0] = min(lowest[0], stage.craft.battery.soc)

    outcome = stage.fly(on_tick=watch)
    craft = stage.craft
    records = read_journal(stage.journal_path).records
    acts = [record.data["action"] for record in records if record.event == "decision"]
    return Told(
        seed=seed,
        autopilot=story.autopilot,
        supervised=supervised,
        faults=faults,
        state=outcome.state,
        reason=outcome.reason,
        station=outcome.station,
        true_station=craft.station(),
        crashed=craft.autopilot.crashed or not craft.body.grounded,
        flights=outcome.flights,
        delivery_s=stage.lockstep.now_s if outcome.delivered else None,
        lowest_soc=lowest[0],
        replans=sum(act in ("station", "charge") for act in acts),
        diverts=acts.count("divert"),
        wall_s=time.perf_counter() - begun,
    )


def summary(found: list[Told]) -> str:
    """Tell many in a few lines."""
    times = np.array([one.delivery_s for one in found if one.delivery_s is not None]) / 60.0
    p50, p95 = (float(np.percentile(times, q)) if len(times) else float("nan") for q in (50, 95))
    safe = [one for one in found if one.state == "stopped-safe" and not one.failed]
    return (
        f"{len(found)} deliveries: {sum(one.state == 'delivered' for one in found)} delivered, {len(safe)} safe on a station, "
        f"{sum(one.failed for one in found)} failed, {sum(one.crashed for one in found)} crashed; "
        f"below 20 %: {sum(one.lowest_soc < 0.195 for one in found)}, below 10 %: "
        f"{sum(one.lowest_soc < 0.1 for one in found)}; delivery time p50 {p50:.1f} min, p95 {p95:.1f} min; "
        f"{sum(one.diverts for one in found)} diverts"
    )


def main() -> None:
    """Fly many and print what became of them."""
    asked = argparse.ArgumentParser()
    asked.add_argument("--seeds", type=int, default=300)
    asked.add_argument("--first", type=int, default=0)
    asked.add_argument("--output", type=Path, default=Path("out/supervision.jsonl"))
    asked.add_argument("--blind", action="store_true", help="also fly the first plan as it is")
    asked.add_argument("--forecast", action="store_true", help="planned with a forecast of realistic error")
    given = asked.parse_args()
    given.output.parent.mkdir(parents=True, exist_ok=True)
    kinds = (True, False) if given.blind else (True,)
    with given.output.open("a") as out, tempfile.TemporaryDirectory() as folder:
        for seed in range(given.first, given.first + given.seeds):
            for supervised in kinds:
                place = Path(folder) / f"{seed}-{supervised}"
                place.mkdir()
                one = tell(seed, place, supervised=supervised, forecast=given.forecast)
                if one is not None:
                    out.write(json.dumps(asdict(one)) + "\n")
                    out.flush()
                    print(
                        f"{seed:4} {'with' if supervised else 'blind':5} {one.state:13} {one.reason[:90]}", flush=True
                    )


if __name__ == "__main__":
    main()
