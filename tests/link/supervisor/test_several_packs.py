"""A drone that carries several packs lands by the emptiest of them, whatever it says of the others."""

import math
from itertools import pairwise

import pytest
from wires import Meddler, changed_frame

from benchmarks.link.deliveries import Stage, Story
from skyway.link.supervisor import read_journal

SHORT = {"start": "jersey-city", "to": "hoboken"}
"""The shortest delivery that there is."""
SLACK = 0.0201
"""A report that is under way, and the step of a percentage."""


class Packs:
    """A delivery whose vehicle reports what `spoil(message, frame, in_air_s)` makes of its battery's messages."""

    def __init__(self, folder, spoil):
        self.stage, self.spoil = (
            Stage(Story(supervised=False, still=True, soc=0.6, standing_soc=0.9, **SHORT), folder),
            spoil,
        )
        self.up_s = math.nan
        self.told = []
        """Second of the flight, charge that is counted on, energy ratio learnt so far, and what pack 1 reports."""
        self.pack = math.nan
        connect = self.stage.lockstep.connect
        self.stage.lockstep.connect = lambda *given, **named: Meddler(connect(*given, **named), self._pass)

    @property
    def in_air_s(self):
        return self.stage.lockstep.clock.now_s() - self.up_s

    def _pass(self, number, message, frame, up):
        if up or message is None or message.name not in ("BATTERY_STATUS", "SYS_STATUS"):
            return frame
        return self.spoil(self, message, frame)

    def other(self, message, lower, number=1, **fields):
        """Return the report of pack 1, lower by some percent."""
        self.pack = (message["battery_remaining"] - lower) / 100.0
        return changed_frame(message, id=number, battery_remaining=message["battery_remaining"] - lower, **fields)

    def fly(self):
        def look(ctx):
            if not ctx.in_air or ctx.delivery.leg is None or ctx.delivery.leg.modelled is None:
                return
            if math.isnan(self.up_s):
                self.up_s = self.stage.lockstep.clock.now_s()
            ratio = ctx.energy.now(ctx.delivery.leg, ctx.battery.soc).mean_ratio
            self.told.append((self.in_air_s, ctx.battery.soc, ratio, self.pack))

        self.outcome = self.stage.fly(on_tick=look)
        assert len(self.told) > 30, self.outcome
        return self

    def between(self, begin_s, end_s):
        found = [one for one in self.told if begin_s <= one[0] < end_s]
        assert found, self.told[-1]
        return found


def jumps(told):
    """Steps of the energy ratio from one tick to the next."""
    return max(abs(b[2] - a[2]) for a, b in pairwise(told))


def emptier_from_the_ground(packs, message, frame):
    return frame + packs.other(message, 20) if message.name == "BATTERY_STATUS" else frame


def empties_faster(packs, message, frame):
    lower = 0 if math.isnan(packs.up_s) else int(packs.in_air_s / 4.0)
    return frame + packs.other(message, lower) if message.name == "BATTERY_STATUS" else frame


def without_the_first(packs, message, frame):
    """Pack 0 falls silent in flight, and SYS_STATUS reports no charge."""
    if message.name == "SYS_STATUS":
        return changed_frame(message, battery_remaining=-1)
    return packs.other(message, 20) + (b"" if packs.in_air_s > 10.0 else frame)


@pytest.mark.parametrize("spoil", [emptier_from_the_ground, empties_faster, without_the_first])
def test_the_charge_in_flight_is_that_of_the_emptiest_pack(spoil, tmp_path):
    packs = Packs(tmp_path, spoil).fly()
    assert [one for one in packs.told if one[1] > one[3] + SLACK] == []
    assert jumps(packs.told) < 0.07  # the steps of whole percents
    assert [
        one for one in packs.told if one[1] < one[3] - 2.0 * SLACK
    ] == []  # and no charge is taken away that is there


def test_a_pack_that_is_first_reported_in_flight_counts_soon_and_teaches_nothing(tmp_path):
    def spoil(packs, message, frame):
        late = message.name == "BATTERY_STATUS" and packs.in_air_s > 40.0
        return frame + packs.other(message, 25) if late else frame

    packs = Packs(tmp_path, spoil).fly()
    before = packs.between(30.0, 40.0)[-1]
    after = packs.between(50.0, 60.0)
    assert all(soc <= pack + SLACK for _, soc, _, pack in after)
    assert after[0][1] < before[1] - 0.2
    assert after[0][2] == pytest.approx(before[2], abs=0.03)
    said = [one.reason for one in read_journal(packs.stage.journal_path).records if one.reason]
    assert any("battery 1 reports" in one and "the emptiest battery decides" in one for one in said), said


@pytest.mark.parametrize("then", ["silent", "unknown"])
def test_an_emptiest_pack_that_reports_no_more_is_not_taken_for_full(then, tmp_path):
    def spoil(packs, message, frame):
        if message.name != "BATTERY_STATUS":
            return frame
        if packs.in_air_s > 20.0:
            return frame if then == "silent" else frame + changed_frame(message, id=1, battery_remaining=-1)
        return frame + packs.other(message, 20)

    packs = Packs(tmp_path, spoil).fly()
    pack = packs.between(15.0, 20.0)[-1][3]
    later = packs.between(55.0, 1000.0)
    assert all(soc <= pack for _, soc, _, _ in later)
    assert all(b[1] <= a[1] + SLACK for a, b in pairwise(later))


def test_one_wrong_report_of_another_pack_is_not_flown_by(tmp_path):
    sent = []

    def spoil(packs, message, frame):
        if message.name == "BATTERY_STATUS" and packs.in_air_s > 30.0 and not sent:
            sent.append(packs.in_air_s)
            return frame + changed_frame(message, id=5, battery_remaining=1)
        return frame

    packs = Packs(tmp_path, spoil).fly()
    assert sent
    assert packs.told[-1][1] > 0.3
    assert packs.outcome.delivered, packs.outcome


def test_a_pack_that_falls_and_stays_low_is_believed_though_the_common_voltage_shows_nothing(tmp_path):
    def spoil(packs, message, frame):
        if message.name != "BATTERY_STATUS":
            return frame
        return frame + packs.other(message, 30 if packs.in_air_s > 30.0 else 0)

    packs = Packs(tmp_path, spoil).fly()
    assert all(soc <= pack + SLACK for at_s, soc, _, pack in packs.between(65.0, 1000.0))


def test_a_pack_of_the_payload_and_one_that_reports_nothing_are_told_apart_before_the_take_off(tmp_path):
    def payload(packs, message, frame):
        mine = message.name == "BATTERY_STATUS"
        return frame + changed_frame(message, id=1, battery_remaining=3, battery_function=4) if mine else frame

    for name in ("payload", "unknown"):
        (tmp_path / name).mkdir()
    assert Packs(tmp_path / "payload", payload).fly().outcome.delivered

    def unknown(packs, message, frame):
        return frame + changed_frame(message, id=1, battery_remaining=-1) if message.name == "BATTERY_STATUS" else frame

    packs = Packs(tmp_path / "unknown", unknown)
    outcome = packs.stage.fly()
    assert outcome.state == "stopped-safe"
    assert "battery 1 reports no state of charge: set up its battery monitor" in outcome.reason
