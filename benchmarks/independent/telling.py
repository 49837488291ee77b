"""What a drone is told: reports that are out, who waits at stations, its gauge."""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchmarks.independent.information import Seen

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchmarks.independent.delivery import Run, Setting


def reports(setting: Setting, run: int, time_s: float) -> dict[str, tuple[float, float, float]]:
    """Of each told site the latest report that is out, as in `information.Seen`."""
    found = {}
    shift = float(setting.shift_s[run])
    for site in setting.told:
        k = site.latest(time_s + shift)
        if k >= 0:
            found[site.id] = (float(site.time_s[k]) - shift, float(site.wind[k, 0]), float(site.wind[k, 1]))
    return found


def lines(setting: Setting, run: int, node: int, landed_s: float, time_s: float) -> Callable[[int], int]:
    """Who is at a station now, as its pad service tells; at `node` those before a drone that landed then."""
    stations = setting.stations[run]

    def line(other: int) -> int:
        found = stations.line(other)
        return found.before(landed_s, time_s) + found.out if other == node else found.told(time_s)

    return line


def seen(setting: Setting, run: Run, node: int, landed_s: float, time_s: float, soc: float) -> Seen:
    """What is known on the ground, or over a station."""
    here = setting.stations[run.number].line(node)
    return Seen(
        run.number, node, setting.ground.ids[node], landed_s, time_s,
        float(setting.batteries.told_one(run.number, soc)), reports(setting, run.number, time_s),
        lines(setting, run.number, node, landed_s, time_s), here.present(time_s) - here.before(landed_s, time_s),
        tuple(run.flights),
    )  # fmt: skip
