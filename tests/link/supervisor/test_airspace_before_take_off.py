"""Zones are looked at again before a take-off: a flight goes around one that has come since the plan, or waits for it to end."""

import json
from dataclasses import replace
from datetime import UTC, datetime

import pytest
import shapely

from benchmarks.link.deliveries import Stage, Story
from skyway.link.supervisor import read_journal

CLOSED_S = 120.0


@pytest.mark.slow
@pytest.mark.parametrize("over", ["the way", "the start"])
def test_a_flight_goes_around_a_new_zone_or_waits_for_it_to_end(over, tmp_path, monkeypatch):
    stage = Stage(Story(autopilot="px4", start="bellevue", to="city-hall", traffic=False), tmp_path)
    depart_s = stage.composition.services[0].depart.timestamp()
    a, b = (stage.composition.stations[name] for name in ("bellevue", "city-hall"))
    lat, lon, r = (a.lat + b.lat) / 2.0, (a.lon + b.lon) / 2.0, 0.003
    if over == "the start":
        lat, lon = a.lat, a.lon
    ends = (depart_s - 3600.0, depart_s + CLOSED_S)
    times = [datetime.fromtimestamp(time_s, UTC).isoformat() for time_s in ends]
    box = shapely.box(lon - r, lat - r, lon + r, lat + r)
    properties = {"id": "FAIR", "kind": "prohibited", "from": times[0], "until": times[1]}
    path = tmp_path / "zones.geojson"
    path.write_text(
        json.dumps({"type": "Feature", "geometry": shapely.geometry.mapping(box), "properties": properties})
    )
    planned = Stage.job

    def zoned(self):
        job = planned(self)
        return replace(job, scenario=job.scenario.with_airspace([path]))

    monkeypatch.setattr(Stage, "job", zoned)
    track, flown = [], stage.craft.body

    def watch(ctx):
        if ctx.place is not None and stage.craft.autopilot.armed:
            track.append((ctx.now_s, *ctx.place[:2]))

    outcome = stage.fly(on_tick=watch)
    assert outcome.delivered, outcome
    assert flown.payload_kg == 0.0
    inside = [time_s for time_s, *place in track if box.covers(shapely.Point(place[1], place[0]))]
    assert all(time_s >= depart_s + CLOSED_S for time_s in inside)
    records = read_journal(stage.journal_path).records
    (leaves, *_) = [record for record in records if record.event == "state" and record.data["after"] == "flying"]
    waited = datetime.fromisoformat(leaves.time).timestamp() >= depart_s + CLOSED_S
    assert waited == (over == "the start")
    assert bool(inside) == waited
    assert len(track) > 20
