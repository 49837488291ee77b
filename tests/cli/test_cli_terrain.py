"""The command line over terrain: the example, what plan, mission and check say, and what is refused."""

import json

import pytest
from cli_requests import HOP, ONE_WIND

from skyway.missions.examples import NEW_YORK
from skyway.report.heights import planned_heights

HILLS = ("plan", "hills", "--from", "depot", "--to", "midvale", "--payload", "0.8", "--wind", "6@250", "--depart", "2026-06-01T10:00Z", "--planner", "exact")  # fmt: skip


def test_the_example_is_planned_flown_over_and_checked(skyway, tmp_path):
    assert skyway("scenario", "init", "hills", "--example", "hills").code == 0
    assert skyway("terrain", "hills/terrain.tif", "--obstacles", "hills/obstacles.csv").code == 0
    planned = skyway(*HILLS, "-o", "plan.json", "--plot", "plan.svg")
    assert planned.code == 0, planned.err
    document = json.loads((tmp_path / "plan.json").read_text())
    heights = document["legs"][0]["heights"]
    assert heights["least_m"] >= 30.0
    assert max(heights["ground_m"]) > max(place["elevation_m"] for place in document["stations"].values())
    assert "way flown" in (tmp_path / "plan.svg").read_text()
    report = planned_heights(document["legs"][0])
    assert report is not None
    assert planned_heights({"heights": {**heights, "top_m": ["x"]}}) is None
    assert skyway("mission", "plan.json", "-o", "m.plan").code == 0
    over = ("--terrain", "hills/terrain.tif", "--obstacles", "hills/obstacles.csv")
    checked = skyway("check", "m.plan", *over, "--plot", "m.svg")
    assert checked.code == 0, checked.out
    assert "least clearance 32 m over ground and obstacles" in checked.out
    (tmp_path / "tall.csv").write_text(f"name,lat,lon,top_m\nmast,{45.00847},{-30.12957},600\n")
    wrong = skyway("check", "m.plan", "--terrain", "hills/terrain.tif", "--obstacles", "tall.csv")
    assert wrong.code == 1
    assert "touches the obstacle mast at 45.0" in wrong.out
    (tmp_path / "hills" / "terrain.tif").rename(tmp_path / "dem.tif")
    gone = skyway("mission", "plan.json", "-o", "n.plan")
    assert gone.code == 2
    assert "give the terrain of the plan with --terrain" in gone.err
    assert skyway("mission", "plan.json", "-o", "n.plan", "--terrain", "dem.tif").code == 0


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        (("--terrain", "nowhere.tif"), "nowhere.tif: no such file"),
        (("--obstacles", "towers.csv"), "obstacles stand on ground that is not known"),
        (("--terrain", "hills.tif"), "no height at any station: the terrain model reaches over 44.92 to 45.12 N"),
    ],
)
def test_terrain_that_does_not_serve_is_said_in_one_line(skyway, tmp_path, more, expected):
    (tmp_path / "hills.tif").write_bytes((NEW_YORK.parent / "hills" / "terrain.tif").read_bytes())
    (tmp_path / "towers.csv").write_text("lat,lon,height_m\n40.7,-74.0,100\n")
    answer = skyway("plan", *HOP, *ONE_WIND, *more)
    assert answer.code == 2
    assert expected in answer.err
    assert answer.err.count("\n") == 1


def test_feet_and_swapped_places_are_told(skyway, tmp_path):
    skyway("scenario", "init", "hills", "--example", "hills")
    stations = (tmp_path / "hills" / "stations.csv").read_text().splitlines()
    feet = [stations[0], *(line.replace(",,", f",{round(140 / 0.3048)},") for line in stations[1:])]
    (tmp_path / "hills" / "stations.csv").write_text("\n".join(feet) + "\n")
    assert "look like feet taken for metres" in skyway("scenario", "check", "hills").err
    swapped = [stations[0], *(",".join([c[0], c[1], c[3], c[2], *c[4:]]) for c in (line.split(",") for line in stations[1:]))]  # fmt: skip
    (tmp_path / "hills" / "stations.csv").write_text("\n".join(swapped) + "\n")
    answer = skyway("scenario", "check", "hills")
    assert answer.code == 2
    assert "or lat and lon of the stations are swapped" in answer.err


def test_a_single_obstacle_is_counted_in_the_singular(skyway, tmp_path):
    (tmp_path / "towers.csv").write_text("lat,lon,height_m\n40.7,-74.0,100\n")
    assert "towers.csv: 1 point of obstacles" in skyway("terrain", "--obstacles", "towers.csv").out


def test_obstacles_of_elsewhere_are_told_and_swapped_ones_refused(skyway, tmp_path):
    """The hills lie at 45 N, 30 W."""
    skyway("scenario", "init", "hills", "--example", "hills")
    skyway(*HILLS, "-o", "plan.json")
    skyway("mission", "plan.json", "-o", "m.plan")
    near, swapped, far = "45.03,-30.13", "-30.13,45.03", "47.0,8.0"
    for name, places in (
        ("near", (near,)), ("swapped", (swapped,)), ("one", (near, swapped)), ("far", (far,)), ("many", (swapped,) * 30),
        ("country", (near, *(far,) * 30)),
    ):  # fmt: skip
        rows = "".join(f"{name} {number},{place},40\n" for number, place in enumerate(places))
        (tmp_path / f"{name}.csv").write_text(f"name,lat,lon,height_m\n{rows}")

    def asked(command, name):
        if command == "plan":
            return skyway(*HILLS, "--obstacles", f"{name}.csv")
        return skyway("check", "m.plan", "--terrain", "hills/terrain.tif", "--obstacles", f"{name}.csv")

    for command, what in (("plan", "the stations"), ("check", "the mission")):
        for name, place in (("swapped", "swapped 0"), ("one", "one 1"), ("many", "many 0")):
            answer = asked(command, name)
            assert answer.code == 2
            assert f"{name}.csv: {place}: lat and lon look swapped" in answer.err
        answer = asked(command, "far")
        assert answer.code == 0, answer.err
        assert f"far.csv: no obstacle lies near {what}: the nearest is" in answer.out + answer.err
        for name in ("near", "country"):
            answer = asked(command, name)
            assert answer.code == 0, answer.err
            assert "no obstacle lies near" not in answer.out + answer.err


def test_a_place_beyond_the_files_with_lat_and_lon_swapped_is_refused(skyway):
    skyway("scenario", "init", "hills", "--example", "hills")
    answer = skyway("terrain", "hills/terrain.tif", "--at", "-30.13,45.03")
    assert answer.code == 2
    assert "--at: lies beyond the files: lat and lon look swapped" in answer.err
    assert "beyond the files" in skyway("terrain", "hills/terrain.tif", "--at", "47.0,8.0").out
