"""A folder of a cut mission that is not as it was written is refused with what is wrong; so is a drone that it was not cut for."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest
from docs_pages import ROOT

from skyway.cli.main import main
from skyway.missions.autopilots.registry import family_named
from skyway.models.base.errors import InputError
from skyway.models.base.units import from_posix
from skyway.recharge.flying.work_job import WorkAsked, work_of_set
from skyway.recharge.made_of import SET, opened

FIELD = {name: (ROOT / "docs" / "how-to" / "recharge.md").read_text() for name in ("page",)}["page"]
NOON = from_posix(1_777_896_000.0)


def written(name, folder):
    """Write a file of the how-to."""
    text = FIELD.split(f"<!-- file: {name} -->\n```")[1].split("\n", 1)[1].split("```")[0]
    (folder / name).write_text(text)
    return str(folder / name)


@pytest.fixture(scope="module")
def cut(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cut")
    survey, pads = written("survey.plan", folder), written("pads.csv", folder)
    asked = ["--pads", pads, "--wind", "6@250", "--drone", "m200-v2", "--autopilot", "px4"]
    assert main(["recharge", survey, *asked, "-o", str(folder / "flights")]) == 0
    return folder / "flights"


@pytest.fixture
def copy(cut, tmp_path):
    return Path(shutil.copytree(cut, tmp_path / "copy"))


def refused(folder):
    with pytest.raises(InputError) as refusal:
        opened(folder)
    return str(refusal.value)


def test_a_folder_that_was_moved_is_flown_as_it_was_cut(cut, copy):
    assert len(opened(copy).found.plan.stops) == len(opened(cut).found.plan.stops) > 0


def test_an_edited_mission_is_named(copy):
    file = copy / "px4" / "battery-2.plan"
    file.write_text(file.read_text().replace("60", "61", 1))
    assert "battery-2.plan" in refused(copy)
    assert "edited" in refused(copy)


def test_a_folder_that_is_half_there_is_named(copy):
    (copy / "px4" / "battery-1.plan").unlink()
    assert "incomplete" in refused(copy)
    (copy / SET).unlink()
    assert "incomplete" in refused(copy)


def test_an_edited_list_is_refused(copy):
    data = json.loads((copy / SET).read_text())
    data["asked"]["reserve_percent"] = 5.0
    (copy / SET).write_text(json.dumps(data))
    assert "edited" in refused(copy)


def test_another_folder_is_no_set(tmp_path, capsys):
    assert main(["fly", str(tmp_path), "--connect", "udpin:127.0.0.1:14999"]) == 2
    assert "skyway recharge -o" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("autopilot", "kind", "said"), [("ardupilot", 2, "--autopilot ardupilot"), ("px4", 1, "multirotor")]
)
def test_another_drone_than_it_was_cut_for_is_refused(cut, autopilot, kind, said):
    vehicle = SimpleNamespace(family=family_named(autopilot), peer=SimpleNamespace(kind=kind))
    with pytest.raises(InputError) as refusal:
        work_of_set(opened(cut), vehicle, NOON, WorkAsked())
    assert said in str(refusal.value)
