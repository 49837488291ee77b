"""How figures are put into words: one rule for each quantity, and nobody else formats them."""

from __future__ import annotations

import ast
import math
import re
from datetime import UTC, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import skyway.models.base.formatting as words
from skyway.models.base.statistics import Figure

ROOT = Path(words.__file__).resolve().parents[2]
FLOORS = ("models", "planner", "missions", "link", "sim_stub", "skyway")
ELSEWHERE = {
    "models/wind/forecast.py": "days of a season without a year",
    "models/base/formatting.py": "the rules themselves",
    "models/wind/columns.py": "patterns of dates in the files of other people",
    "skyway/report/svg.py": "names of the ticks of a time axis, as long as its span needs",
    "skyway/plots/charge.py": "ticks of an axis, named by matplotlib",
    "skyway/flying.py": "the name of a file",
    "skyway/fetching/providers.py": "addresses of files on the servers of other people",
    "link/wire/recorder.py": "the name of a file",
    "link/telemetry/timebase.py": "milliseconds, in which clocks are compared",
    "sim_stub/autopilot/px4/missions.py": "what PX4 says, letter by letter",
    "sim_stub/autopilot/px4/px4.py": "the name of a file",
}
UNIT = re.compile(r" ?(%|km|min|m/s(?!²)|Wh|kg|h|s|m)(?![\w/²])")
SCALES = {60.0, 100.0, 1000.0, 3600.0}
SCALE_NAMES = {"S_PER_MIN", "S_PER_H", "J_PER_WH"}


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        (words.duration(20.4), "20 s"),
        (words.duration(59.6), "1 min"),
        (words.duration(596.0), "9.9 min"),
        (words.duration(597.0), "10 min"),
        (words.duration(4320.0), "1 h 12 min"),
        (words.duration(-300.0), "-5 min"),
        (words.duration(75.0, signed=True), "+1.2 min"),
        (words.duration(None), "unknown"),
        (words.counter(249.4), "0:04:09"),
        (words.counter(3755.0), "1:02:35"),
        (words.counter(math.inf), "unknown"),
        (words.percent(0.996), "100 %"),
        (words.percent(0.0005, None), "0.05 %"),
        (words.percent(0.125, None), "12.5 %"),
        (words.percent(-0.043, 1, signed=True), "-4.3 %"),
        (words.percent(math.nan), "unknown"),
        (words.probability(0.996), ">99 %"),
        (words.probability(0.9996, 1), ">99.9 %"),
        (words.probability(0.001), "<1 %"),
        (words.probability(0.0), "0 %"),
        (words.probability(1.0), "100 %"),
        (words.modelled(1.0), ">99.9 %"),
        (words.modelled(0.0), "<0.1 %"),
        (words.modelled(0.907), "90.7 %"),
        (words.modelled(None), "unknown"),
        (words.distance_text(999.4), "999 m"),
        (words.distance_text(999.6), "1.0 km"),
        (words.distance_text(None), "unknown"),
        (words.height_text(1234.0), "1234 m"),
        (words.speed_text(7.44), "7.4 m/s"),
        (words.wind_text(7.44, 359.7, 0.81), "7.4 ± 0.8 m/s from 000°"),
        (words.energy_text(41.3 * 3600.0), "41.3 Wh"),
        (words.energy_text(99.96 * 3600.0), "100 Wh"),
        (words.money(1234.5), "1,234.50"),
        (words.money(0.0432), "0.043"),
        (words.mass_text(2.34567), "2.346 kg"),
        (words.place_text(40.712345678, -74.0), "40.71235,-74.00000"),
        (words.stored_degrees(40.712345678, -74.0), ("40.7123457", "-74.0000000")),
        (words.zone_clock(datetime(2013, 7, 10, 18, 3, 22, tzinfo=UTC), ZoneInfo("America/New_York")), "14:03:22 EDT"),
        (words.local_clock(0.0, UTC), "00:00:00"),
        (words.date_clock(datetime(2013, 7, 10, 18, 3, 22, tzinfo=UTC)), "2013-07-10 18:03"),
    ],
)
def test_each_quantity_has_one_rule(said: object, expected: object) -> None:
    assert said == expected


@pytest.mark.parametrize("floor", FLOORS)
def test_no_other_module_formats_these_quantities(floor: str) -> None:
    own = [
        f"{name}:{line}: {what}"
        for path in sorted((ROOT / floor).rglob("*.py"))
        if (name := path.relative_to(ROOT).as_posix()) not in ELSEWHERE
        for line, what in _own_formats(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert own == []


def test_every_exception_is_needed() -> None:
    for name in ELSEWHERE:
        assert list(_own_formats(ast.parse((ROOT / name).read_text(encoding="utf-8")))), name


def _own_formats(tree: ast.AST) -> list[tuple[int, str]]:
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            found += [(node.lineno, what) for what in map(_own_figure, node.values, [*node.values[1:], None]) if what]
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "strftime":
            found.append((node.lineno, "strftime: use a clock of `formatting`"))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "divmod" and _scale(node.args[1]):
            found.append((node.lineno, "divmod: use `duration` or `counter`"))
        if (
            isinstance(node, ast.BinOp)
            and isinstance(node.op, ast.FloorDiv)
            and ast.unparse(node.right) in ("60", "3600")
        ):
            found.append((node.lineno, "// 60: use `duration` or `counter`"))
    return found


def _own_figure(value: ast.expr, following: ast.expr | None) -> str | None:
    if not isinstance(value, ast.FormattedValue) or not isinstance(value.format_spec, ast.JoinedStr):
        return None
    spec = "".join(part.value for part in value.format_spec.values if isinstance(part, ast.Constant))
    if "%" in spec:
        return f"{{:{spec}}}"
    text = following.value if isinstance(following, ast.Constant) else ""
    rounded = re.fullmatch(r"[+]?\.\d[f%]", spec)
    if rounded and (UNIT.match(text) or (isinstance(value.value, ast.BinOp) and _scaled(value.value))):
        return f"{{{ast.unparse(value.value)}:{spec}}}{text[:5]}"
    return None


def _scaled(expression: ast.BinOp) -> bool:
    sides = (expression.left, expression.right) if isinstance(expression.op, ast.Mult) else (expression.right,)
    return isinstance(expression.op, ast.Mult | ast.Div) and any(map(_scale, sides))


def _scale(node: ast.expr) -> bool:
    return (isinstance(node, ast.Constant) and node.value in SCALES) or ast.unparse(node) in SCALE_NAMES


@given(st.floats(60, 1e5), st.floats(0, 1e4), st.floats(1, 1e4), st.floats(1, 1e4))
@example(60.0, 0.0, 1.0, 2761.0)  # its step would grow with its value
def test_promised_quantiles_are_rounded_up_and_never_told_as_an_earlier_time(early, more, half_early, half_late):
    given = [
        Figure(value, value - half, value + half) for value, half in ((early, half_early), (early + more, half_late))
    ]
    first, second = words.promised(*given)
    assert words.rounded_s(first) == pytest.approx(first.value)
    assert words.rounded_s(second) == pytest.approx(second.value)
    assert words.rounded_s(second) >= words.rounded_s(first)
    assert given[0].value - 1e-3 <= first.value < given[0].value + words.step_of(first)
    assert given[1].value - 1e-3 <= second.value < max(given[1].value, first.value) + words.step_of(second)


@given(st.floats(60, 1e6), st.floats(0.01, 0.99), st.floats(0, 1e6))
def test_however_uncertain_a_time_is_it_is_told_to_a_twentieth(value, below, above):
    figure = Figure(value, value * (1.0 - below), value + above)
    assert words.rounded_s(figure) == pytest.approx(value, rel=0.0501)


def test_a_time_of_an_earlier_day_has_the_days_before():
    midnight = datetime(2013, 7, 11, tzinfo=UTC)
    assert words.clock(midnight - timedelta(minutes=5), UTC, midnight) == "23:55 -1d"
    assert words.clock(midnight + timedelta(minutes=5), UTC, midnight - timedelta(minutes=5)) == "00:05 +1d"


def test_after_the_clock_was_changed_times_name_their_zone():
    zone = ZoneInfo("America/New_York")
    spring, autumn = (datetime(2013, *day, tzinfo=UTC) for day in ((3, 10, 6, 30), (11, 3, 5, 30)))
    assert words.clock(spring, zone, spring) == "01:30"
    assert words.clock(spring + timedelta(hours=1), zone, spring) == "03:30 EDT"
    assert words.clock(autumn + timedelta(hours=1), zone, autumn) == "01:30 EST"
    assert words.clock(autumn + timedelta(hours=25), zone, autumn) == "01:30 EST +1d"


@pytest.mark.parametrize(
    ("value", "low", "high", "told"),
    [
        (
            36_720.0,
            17_600.0,
            119_765.0,
            "4 h 45 min to 36 h",
        ),  # the lower end was lost in the step of the upper one: 0 min
        (4927.0, 1209.0, 22_371.0, "20 min to 6 h 30 min"),  # the same
        (5400.0, 4800.0, 6000.0, "1 h 20 min to 1 h 40 min"),
        (5400.0, 5400.0, 5400.0, ""),
        (1080.0, 1069.0, 1095.0, "17 min 45 s to 18 min 15 s"),
    ],
)
def test_the_ends_of_an_interval_are_as_exact_as_they_are_known(value, low, high, told):
    assert words.between(Figure(value, low, high)) == told


@given(st.floats(60, 1e5), st.floats(0, 1.0), st.floats(0, 1e5))
def test_an_interval_holds_its_value_as_it_is_told(value, below, above):
    figure = Figure(value, value * (1.0 - below), value + above)
    ends = words.between(figure).split(" to ")
    assert len(ends) == 1 or _seconds(ends[0]) <= words.rounded_s(figure) <= _seconds(ends[1])
    if len(ends) == 2:
        assert _seconds(ends[0]) <= figure.low + 1.0
        assert _seconds(ends[1]) >= figure.high - 1.0


def _seconds(text: str) -> float:
    number = {unit: float(count) for count, unit in re.findall(r"(\d+) (h|min|s)", text)}
    return 3600.0 * number.get("h", 0.0) + 60.0 * number.get("min", 0.0) + number.get("s", 0.0)


def test_a_difference_that_is_not_clear_has_no_negative_figure():
    said = "no clear difference on average"
    assert words.later_text(Figure(-7200.0, -16_200.0, 1800.0, 4500.0)) == f"{said} (120 ± 150 min earlier)"
    assert words.later_text(Figure(7200.0, -1800.0, 16_200.0, 4500.0)) == f"{said} (120 ± 150 min)"
    assert words.minutes(Figure(-1e-7, -1e-7, -1e-7)) == "0.0"
    assert words.minutes(Figure(-0.5, -60.0, 60.0, 30.0)).startswith("0.0 ± ")
