"""Windows of pads of a flight under way that is late."""

from skyway.dispatch.dispatcher.windows import windows_of
from skyway.dispatch.records import PlanStep
from skyway.models.base.units import from_posix
from skyway.models.ledger.window import Window

NOON_S = 1_783_684_800.0
LATE_S = 3600.0


def charge(begin_min, end_min, pad):
    return PlanStep(
        kind="charge", origin="a", destination="a", begin_s=NOON_S + 60.0 * begin_min, end_s=NOON_S + 60.0 * end_min,
        soc_begin=0.3, soc_end=0.5, pad=pad,
    )  # fmt: skip


def window(begin_min, end_min, pad):
    return Window(
        station="a", pad=pad, start=from_posix(NOON_S + 60.0 * begin_min), end=from_posix(NOON_S + 60.0 * end_min)
    )


def test_a_late_drone_that_charges_twice_in_a_row_holds_one_pad_at_a_time():
    steps = [charge(0, 10, 1), charge(10, 40, 2)]
    assert windows_of(steps, not_before_s=NOON_S) == [window(0, 10, 1), window(10, 40, 2)]
    first, second = window(0, 70, 1), window(70, 100, 2)
    assert windows_of(steps, LATE_S, not_before_s=NOON_S + 1200.0) == [first, second]
    assert windows_of(steps, LATE_S, not_before_s=NOON_S + 4800.0) == [second]
