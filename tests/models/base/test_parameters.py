"""Parameters by name: listed, checked, changed, compared with their defaults."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.base.errors import InputError
from skyway.models.base.parameters import (
    Parameters,
    changed,
    entries,
    parameter,
    text_of,
    with_settings,
    with_values,
)
from skyway.settings import Settings


@dataclass(frozen=True)
class Small(Parameters):
    """Part of a tree."""

    runs: int = parameter(3, "runs", 1, 10)
    share: float = parameter(0.5, "share", 0, 1)
    steps: tuple[float, ...] = parameter((1.0, math.inf), "steps", 0, unit="s")
    quick: bool = parameter(False, "quick")


@dataclass(frozen=True)
class Tree(Parameters):
    """Tree of one part."""

    small: Small = field(default_factory=Small)


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("small.rums=3", "small.rums: no such parameter; near it: small.runs"),
        ("runs=3", "runs: no such parameter; near it: small.runs"),
        ("small.runs=11", "small.runs: out of range (got '11'); 1 to 10"),
        ("small.runs=2.5", "small.runs: has another type (got '2.5'); a whole number"),
        ("small.share=nan", "small.share: out of range (got 'nan'); 0 to 1"),
        ("small.share=much", "small.share: has another type (got 'much'); a number"),
        ("small.steps=1,-2", "small.steps: out of range (got '(1.0, -2.0)'); 0 or more s"),
        ("small.steps=", "small.steps: has another type (got ''); numbers with commas between them"),
        ("small.quick=perhaps", "small.quick: is not true or false (got 'perhaps')"),
        ("small.runs", "--set: is not name=value (got 'small.runs'); planner.robust.members=50"),
    ],
)
def test_a_setting_that_cannot_be_is_refused_by_one_clear_line(setting: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        with_settings(Tree(), [setting])
    assert str(caught.value).startswith(said)


def test_a_part_refuses_values_out_of_range_from_python_too() -> None:
    with pytest.raises(InputError, match="runs"):
        Small(runs=0)
    with pytest.raises(InputError, match="no such parameter"):
        with_values(Tree(), {"small.none": 1})


@given(
    st.integers(1, 10),
    st.floats(0, 1),
    st.lists(st.floats(0, allow_nan=False), min_size=1, max_size=4),
    st.booleans(),
)
def test_what_was_changed_makes_the_same_tree_again(runs: int, share: float, steps: list[float], quick: bool) -> None:
    tree = with_values(
        Tree(), {"small.runs": runs, "small.share": share, "small.steps": tuple(steps), "small.quick": quick}
    )
    assert with_settings(Tree(), [f"{name}={text}" for name, text in changed(tree).items()]) == tree


def test_defaults_are_no_change_and_the_last_of_two_settings_counts() -> None:
    assert changed(Settings()) == {}
    tree = with_settings(Settings(), ["planner.robust.members=40", "planner.robust.members=50"])
    assert tree.planner.robust.members == 50
    assert changed(tree) == {"planner.robust.members": "50"}


def test_every_parameter_lies_in_its_range_and_says_what_it_decides() -> None:
    for one in entries(Settings()):
        assert one.fault(one.default) is None, one.name
        assert with_settings(Settings(), [f"{one.name}={text_of(one.default)}"]) == Settings(), one.name
        assert len(one.meaning.split()) >= 3 or one.meaning.startswith("see "), one.name
