"""What is clearly safer in the air: landings below the reserve count where nothing worse is likelier."""

from hypothesis import given
from hypothesis import strategies as st

from skyway.planner.online.options import Option, clearly_safer

SHARE = 0.5
PROBABILITY = st.floats(0.0, 1.0)


def option(p_reserve, p_half, p_empty, p_no_room=0.0):
    return Option("jacobi", 20.0, 0.0, 0.3, p_reserve, p_half, p_empty, 1000.0, p_no_room)


def test_winds_in_which_no_station_is_reached_do_not_hide_the_difference():
    # White Plains to Elizabeth on 23 December 2013: 17 % against 0.7 %, and 0.5 % of an empty battery with both.
    on, near = option(0.1723, 0.0216, 0.00504), option(0.0073, 0.00554, 0.004694)
    assert near.risk > SHARE * on.risk
    assert clearly_safer(near, on, SHARE)
    assert not clearly_safer(on, near, SHARE)


def test_fewer_landings_below_the_reserve_do_not_pay_for_an_empty_battery():
    assert not clearly_safer(option(0.05, 0.02, 0.01), option(0.2, 0.01, 0.004), SHARE)


@given(*[PROBABILITY] * 8)
def test_nothing_is_clearly_safer_than_itself_and_no_two_than_each_other(a, b, c, d, e, f, g, h):
    one, other = option(a, a * b, a * b * c, d), option(e, e * f, e * f * g, h)
    assert not clearly_safer(one, one, SHARE)
    assert not (clearly_safer(one, other, SHARE) and clearly_safer(other, one, SHARE))
