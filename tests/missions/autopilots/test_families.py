"""A family of autopilots is one folder and one line: nothing else names one, and an invented third one works at once."""

import ast
import math
from pathlib import Path

import pytest
from invented_family import FIRMWARE, NAME, Invented, SimulatedInvented
from wires import Scene, a_mission, waypoint

from skyway.cli import options
from skyway.link.vehicle.vehicle import Vehicle
from skyway.missions import check, family_named, leg_mission, whole_mission
from skyway.missions.autopilots import NAMES
from skyway.missions.autopilots.registry import FAMILIES, family_of
from skyway.missions.items.commands import Command
from skyway.missions.items.mission import Mission
from skyway.sim_stub import autopilot as simulated
from skyway.sim_stub.autopilot import registry as simulator

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = ("link", "missions", "models", "planner", "sim_stub", "skyway")
REGISTRIES = {"missions/autopilots/__init__.py", "sim_stub/autopilot/__init__.py"}


@pytest.fixture
def invented(monkeypatch):
    monkeypatch.setitem(FAMILIES, NAME, Invented())
    monkeypatch.setitem(simulator.FAMILIES, NAME, SimulatedInvented)
    return FAMILIES[NAME]


def test_the_families_are_those_of_the_folders_that_are_named():
    assert tuple(FAMILIES) == NAMES
    assert tuple(simulator.FAMILIES) == simulated.NAMES
    assert [family.name for family in FAMILIES.values()] == list(NAMES)
    assert options.FamilyName.__args__ == NAMES
    for name, kind in simulator.FAMILIES.items():
        assert family_of(kind.AUTOPILOT_ID) is FAMILIES[name]


def test_no_code_outside_the_folders_of_the_families_names_one():
    named = set()
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            where = path.relative_to(ROOT)
            if path.is_symlink() or str(where) in REGISTRIES or set(where.parts) & set(NAMES):
                continue
            tree = ast.parse(path.read_text(encoding="utf-8"))
            words = (node.value for node in ast.walk(tree) if isinstance(node, ast.Constant))
            named |= {(str(where), word) for word in words if word in NAMES}
    assert named == set()


def test_a_third_family_exports_and_checks_missions(invented, two_legs):
    assert family_named(NAME) is family_of(FIRMWARE) is invented
    (document,) = whole_mission(two_legs, invented).documents
    assert document.mission.firmware == FIRMWARE
    assert check(document).ok
    jump = Mission((*document.mission.items, waypoint(1, command=Command.DO_JUMP)), firmware=FIRMWARE)
    assert "invented-no-jump" in {finding.code for finding in check(jump).findings}
    export = leg_mission(two_legs, 0, invented)
    assert "INV_SPEED" in invented.parameter_file(export.parameters, "1.0")


def test_a_third_family_is_met_takes_a_mission_and_flies_it(invented):
    scene = Scene(NAME)
    craft = Vehicle(scene.connection)
    assert craft.family is invented
    mission = a_mission(8)
    outcome = craft.upload(mission)
    assert outcome.verified, outcome
    assert craft.verify(mission) == ()
    stored = scene.vehicle.autopilot.stores[0][1:]
    assert [(item.x, item.y) for item in stored] == [(item.x, item.y) for item in mission.items]
    craft.start(30.0)
    assert scene.connection.wait(lambda: craft.mode == "mission" and craft.armed, 10.0)
    assert math.isfinite(craft.home().alt_msl_m)
    craft.set_mode("hold")
    assert craft.mode == "hold"
    assert craft.family.failsafes.by_itself({"link-action": 1.0}) == [
        "link to skyway lost: after some time without skyway it lands (INV_LINK)",
        "remote control lost: it lands (INV_LINK)",
        "battery low: it does what INV_BATT says, which could not be read",
    ]
