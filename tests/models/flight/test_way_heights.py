"""Heights over terrain: nothing is nearer than the clearance, by samples that share nothing with the steps."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Geod

from skyway.models.flight.clearance import Clearance
from skyway.models.flight.way_heights import Over, level_over_m, level_within_m, segment_heights, way_heights, way_steps
from skyway.models.terrain.obstacles import Obstacles
from tests.models.terrain.grids import NORTH, WEST, hills, terrain_of

GEOD = Geod(ellps="WGS84")
NAN = float("nan")


def places(seed, count):
    rng = np.random.default_rng(seed + 1000)
    return [(NORTH - rng.uniform(0.02, 0.11), WEST + rng.uniform(0.02, 0.16)) for _ in range(count)]


def flown(way, found, count=400):
    """Points every few metres along a way with the heights flown there, from its knots alone."""
    lat, lon, height = [], [], []
    knots = list(found.knots)
    for segment, ((lat1, lon1), (lat2, lon2)) in enumerate(pairwise(way)):
        azimuth, _, length = GEOD.inv(lon1, lat1, lon2, lat2)
        here = [k for k in knots if k.segment == segment]
        for share in np.linspace(0.0, 1.0, count):
            x, y, _ = GEOD.fwd(lon1, lat1, azimuth, share * length)
            at = [k.height_m for k in here if abs(k.share - share) < 1e-12]
            least = min(at) if at else np.interp(share, [k.share for k in here], [k.height_m for k in here])
            lat.append(y)
            lon.append(x)
            height.append(least)
    return np.array(lat), np.array(lon), np.array(height)


@settings(max_examples=20)
@given(st.integers(0, 10_000), st.integers(2, 4))
def test_no_ground_or_obstacle_in_the_corridor_is_nearer_than_the_clearance(seed, count):
    rng = np.random.default_rng(seed)
    n = 5
    standing = Obstacles(
        tuple("abcde"), NORTH - rng.uniform(0.02, 0.11, n), WEST + rng.uniform(0.02, 0.16, n), rng.uniform(50, 250, n), np.full(n, NAN), np.zeros(n)
    )  # fmt: skip
    terrain, keeps = terrain_of(hills(seed), obstacles=standing), Clearance()
    way = places(seed, count)
    found = way_heights(way, [NAN] * count, 60.0, Over(terrain, keeps, 60.0))
    lat, lon, height = flown(way, found)
    # places in the corridor: off the way by up to its half width, and the position error
    angle, off = rng.uniform(0, 360, len(lat)), (200.0 + 10.0) * rng.uniform(0, 1, len(lat))
    x, y, _ = GEOD.fwd(lon, lat, angle, off)
    assert (height - terrain.ground_m(np.array(y), np.array(x))).min() >= keeps.least_m - 0.01
    assert (found.height_m - found.ground_m).min() >= 60.0 - 0.01  # the cruise height, where it is sampled
    tops = terrain.ground_m(standing.lat, standing.lon) + standing.agl_m
    for k in range(n):
        _, _, away = GEOD.inv(lon, lat, np.full(len(lon), standing.lon[k]), np.full(len(lat), standing.lat[k]))
        near = np.array(away) <= 210.0
        assert not near.any() or height[near].min() >= tops[k] + keeps.least_m - 0.01


@settings(max_examples=20)
@given(st.integers(0, 10_000), st.floats(10.0, 100.0), st.floats(0.0, 60.0))
def test_more_clearance_is_never_lower_and_never_less_climb(seed, least_m, more_m):
    terrain, way = terrain_of(hills(seed)), places(seed, 2)
    low, high = (
        way_heights(way, [NAN, NAN], 60.0, Over(terrain, Clearance(least_m=keep, max_height_m=10_000.0), 60.0))
        for keep in (least_m, least_m + more_m)
    )
    assert high.height_m.min() >= low.height_m.min() - 1e-9
    assert (high.height_m >= low.height_m - 1e-9).all()
    assert high.up_m >= low.up_m - 1e-9


@settings(max_examples=15)
@given(st.integers(0, 10_000))
def test_climbs_and_descents_are_those_of_the_knots_and_of_the_segments_alone(seed):
    terrain, way = terrain_of(hills(seed)), places(seed, 3)
    over = Over(terrain, Clearance(), 60.0)
    lat, lon = np.array(way).T
    ground = terrain.ground_m(lat, lon)
    found = way_heights(way, ground.tolist(), 60.0, over)
    heights = [ground[0], *(knot.height_m for knot in found.knots), ground[-1]]
    rises = np.diff(heights)
    assert found.up_m == pytest.approx(rises[rises > 0].sum())
    assert found.down_m == pytest.approx(-rises[rises < 0].sum())
    pairs = np.array([[0, 1], [1, 2], [1, 0]])
    alone = segment_heights(lat, lon, ground, pairs, over)
    for row, (a, b) in enumerate(pairs.tolist()):
        one = way_heights([way[a], way[b]], [ground[a], ground[b]], 60.0, over)
        assert (alone.up_m[row], alone.down_m[row]) == pytest.approx((one.up_m, one.down_m))
        assert alone.mean_above_m[row] == pytest.approx(one.mean_above_m)
    # what the planner counts for a leg of two segments is never less than what it climbs
    assert alone.up_m[0] + alone.up_m[1] - 60.0 >= found.up_m - 1e-6
    assert alone.down_m[0] + alone.down_m[1] - 60.0 >= found.down_m - 1e-6


def test_a_leg_steps_over_a_ridge_and_down_again():
    ground = np.full((160, 220), 100.0)
    ground[:, 100:105] = 300.0
    over = Over(terrain_of(ground), Clearance(), 60.0)
    way = [(NORTH - 0.06, WEST + 0.03), (NORTH - 0.06, WEST + 0.15)]
    found = way_heights(way, [100.0, 100.0], 60.0, over)
    levels = [knot.height_m for knot in found.knots]
    assert levels[0] == pytest.approx(160.0)
    assert max(levels) == pytest.approx(360.0)  # the cruise height above the ridge
    assert levels[-1] == pytest.approx(220.0)  # no higher above the ground than 120 m, and no lower than need be
    assert (found.up_m, found.down_m) == pytest.approx((260.0, 260.0))
    steps = way_steps([way[0], (NORTH - 0.06, WEST + 0.08), (NORTH - 0.06, WEST + 0.1), way[1]], over)
    assert (steps.up_m.sum(), steps.down_m.sum(), steps.up_m[2]) == pytest.approx((200.0, 140.0, 0.0))
    assert (steps.begin_m, steps.end_m) == pytest.approx((160.0, 220.0))
    assert level_over_m(way[0], np.array([way[1][0]]), np.array([way[1][1]]), over)[0] == pytest.approx(360.0)
    assert level_within_m([*way, (NORTH - 0.03, WEST + 0.03)], over) == pytest.approx(360.0)


def test_unknown_ground_below_a_way_is_said_and_is_no_height():
    ground = np.full((160, 220), 100.0)
    ground[70:80, 100:105] = np.nan
    over = Over(terrain_of(ground), Clearance(), 60.0)
    way = [(NORTH - 0.0625, WEST + 0.03), (NORTH - 0.0625, WEST + 0.15)]
    found = way_heights(way, [100.0, 100.0], 60.0, over)
    assert found.unknown is not None
    assert abs(found.unknown[1] - (WEST + 0.085)) < 0.01
    beyond = way_heights([way[0], (NORTH - 0.0625, WEST + 0.4)], [100.0, 100.0], 60.0, over)
    assert beyond.unknown is not None
    assert np.isnan(level_over_m(way[0], np.array([way[1][0]]), np.array([way[1][1]]), over)[0])
