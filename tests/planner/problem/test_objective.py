"""Objectives as they are typed, and how they order plans."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.base.errors import InputError
from skyway.planner.problem.objective import Objective, Weights


@pytest.mark.parametrize(
    ("text", "weights"),
    [
        ("cost + 12/h*time", Weights(1.0, 12.0, 0.0)),
        ("12.5 / h * time+cost", Weights(1.0, 12.5, 0.0)),
        ("0.4/kWh*energy + 3/h*time", Weights(0.0, 3.0, 0.4)),
        ("2/h*time", Weights(0.0, 2.0, 0.0)),
    ],
)
def test_sums(text, weights):
    """A sum of cost, time and energy."""
    assert Objective.parse(text).weights == weights


def test_orders():
    """Several objectives in order, each with its tolerance."""
    found = Objective.parse("on-time 2030-07-10T16:00-04:00 within 2%, then cost + 1/h*time, then mean")
    assert [(one.kind, within) for one, within in found.steps] == [("on-time", 0.02), ("sum", 0.01), ("mean", 0.01)]
    assert found.deadline is not None
    assert found.counts_cost
    assert not Objective.parse("p95, then mean").beside_time


@pytest.mark.parametrize(
    "text",
    [
        "", "Cost", "cost,mean", "cost, mean", "cost then mean", "cost + mean", "12*time", "12/min*time", "-1/h*time", "0/h*time",
        "1e3/h*time", "cost + cost", "cost within 5%", "cost within 500%, then mean", "cost, then mean within 5%", "mean, then",
        "cost, then on-time 2030-07-10T16:00-04:00", "nan/h*time", "9999999/h*time", "energy + cost",
    ],
)  # fmt: skip
def test_refused(text):
    """What is not an objective, with what would be."""
    with pytest.raises(InputError) as error:
        Objective.parse(text)
    assert error.value.faults[0].remedy


@given(
    st.lists(st.tuples(st.booleans(), st.floats(0.1, 10.0), st.floats(0.0, 10.0), st.floats(0.0, 1.0)), min_size=1),
    st.sampled_from([0.0, 0.05, 0.5]),
)
def test_an_order_chooses_within_the_tolerance(orders, within):
    """The first is the best by the second objective of those within the tolerance of the best by the first."""
    text = f"energy within {100 * within:g}%, then mean"
    ranked = Objective.parse(text).ranked(orders)
    assert sorted(ranked) == list(range(len(orders)))
    flag = min(one[0] for one in orders)
    able = [one for one in orders if one[0] == flag]
    good = [one for one in able if one[1] <= min(other[1] for other in able) * (1.0 + within)]
    assert orders[ranked[0]] in good
    assert orders[ranked[0]][2:] == min(one[2:] for one in good)


def test_others_are_sorted():
    """Without tolerances the order is that of the numbers."""
    rng = np.random.default_rng(1)
    orders = [tuple(row) for row in rng.integers(0, 3, (20, 3)).tolist()]
    assert [orders[n] for n in Objective("p95").ranked(orders)] == sorted(orders)
