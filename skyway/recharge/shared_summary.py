"""Summary of a mission that several drones share: ``skyway.recharge-drones/1``, and its folder."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.json_text import json_text
from skyway.models.base.statistics import weighted_quantile
from skyway.recharge.made_of import DRONE_MISSION, texts_of
from skyway.recharge.output import SUMMARY, contents_of, names_of, write_contents
from skyway.recharge.simulated import simulated
from skyway.recharge.summary import RechargeSummary, summary_of

if TYPE_CHECKING:
    from pathlib import Path

    from skyway.models.scenario.scenario import Scenario
    from skyway.recharge.made_of import MadeOf
    from skyway.recharge.several import SharedWork

SCHEMA = "skyway.recharge-drones/1"


@dataclass(frozen=True, slots=True)
class PadStay:
    """A pad of a station, and the drone on it over time, seconds after the start of all drones."""

    pad: str
    number: int
    """Number of the pad, from 1."""
    drone: int
    from_s: float
    until_s: float


@dataclass(frozen=True, slots=True)
class DroneTold:
    """Share of one drone."""

    number: int
    folder: str
    """Folder for `skyway fly`."""
    units: int
    home: tuple[float, float] | None
    """Its start, latitude and longitude."""
    summary: RechargeSummary


@dataclass(frozen=True, slots=True)
class DronesSummary:
    """A mission shared among drones: ``skyway.recharge-drones/1``.

    Attributes
    ----------
    units : int
        Independent parts of the mission.
    end_s : float
        End of the last drone, by the plan.
    ends_s : tuple of float
        Simulated end in the same winds: mean, 5th and 95th percentile.
    end_p50_s : float
        In half of the simulated flights all have ended by then.
    p_reserve : float
        Probability that every landing of every drone keeps the reserve.
    alone_s : float or None
        End with one drone, by the plan; None if none can fly it alone.
    bound_s : float
        Lower bound of the last end over all distributions and orders.
    """

    schema: str
    mission: str
    drone: str
    reserve_soc: float
    units: int
    end_s: float
    ends_s: tuple[float, float, float]
    end_p50_s: float
    p_reserve: float
    runs: int
    alone_s: float | None
    bound_s: float
    looked_at: int
    planned: int
    pictures: int
    pictures_off_m: float
    drones: tuple[DroneTold, ...]
    pads: tuple[PadStay, ...]
    """In order of pad and time."""
    notes: tuple[str, ...]


def drones_summary_of(work: SharedWork, mission: str) -> DronesSummary:
    """Return the summary of shared work, each drone simulated in the same winds as the others."""
    runs = [simulated(share.found, drone=number) for number, share in enumerate(work.shares)]
    ends_s = np.max([one.ends_s for one in runs], axis=0)
    kept = np.all([one.kept for one in runs], axis=0)
    one = np.ones(len(ends_s))
    drones, stays = [], []
    for number, (share, flown) in enumerate(zip(work.shares, runs, strict=True), start=1):
        home = share.found.problem.work.mission.home
        drones.append(
            DroneTold(
                number,
                f"drone-{number}",
                share.units,
                None if home is None else (home.point.lat, home.point.lon),
                summary_of(share.found, flown, mission, names_of(share.found)),
            )
        )
        pads = share.found.problem.ways.pads
        stays += [PadStay(pads[one.pad].id, one.number + 1, number, one.from_s, one.until_s) for one in share.stays]
    first = drones[0].summary
    audits = [told.summary.pictures for told in drones]
    return DronesSummary(
        SCHEMA,
        mission,
        first.drone,
        first.reserve_soc,
        work.units,
        work.end_s,
        (float(ends_s.mean()), weighted_quantile(ends_s, one, 0.05), weighted_quantile(ends_s, one, 0.95)),
        weighted_quantile(ends_s, one, 0.5),
        float(kept.mean()),
        len(ends_s),
        work.alone_s,
        work.bound_s,
        work.looked_at,
        work.planned,
        sum(audit.after for audit in audits),
        work.pictures_off_m + max(audit.off_m for audit in audits),
        tuple(drones),
        tuple(sorted(stays, key=lambda stay: (stay.pad, stay.number, stay.from_s))),
        work.notes,
    )


def write_shared(
    work: SharedWork, summary: DronesSummary, made_of: MadeOf, region: Scenario | None, folder: Path, *, force: bool
) -> list[Path]:
    """Write a folder with a folder for each drone, which is flown like any other set, atomically."""
    contents: dict[str, str | bytes] = {SUMMARY: json_text(summary, indent=1) + "\n"}
    for told, share in zip(summary.drones, work.shares, strict=True):
        asked = replace(
            made_of.asked,
            reorder=False,
            laps=1,
            windows={pad: [list(window) for window in windows] for pad, windows in share.windows.items()},
        )
        mine = replace(made_of, asked=asked, mission=made_of.mission.with_name(DRONE_MISSION), written=share.text)
        texts = contents_of(share.found, told.summary, partial(texts_of, mine, region))
        contents |= {f"{told.folder}/{name}": content for name, content in texts.items()}
    return write_contents(contents, folder, force=force)
