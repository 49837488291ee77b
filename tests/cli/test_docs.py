"""The documentation is true: every command and program it shows runs, every output is what comes out."""

import os
import re
import shutil
import subprocess
import sys
import tomllib

import pytest
import yaml
from command_reference import PAGE, page
from docs_pages import ROOT, blocks, pages
from docs_session import Reader, pages_before, reading_order, reasons_not_run


def names_of(paths):
    return [str(path.relative_to(ROOT)) for path in paths]


def tutorial_faults():
    """What the tutorial proposes in its text, beside the blocks."""
    return re.findall(r"`--fault (\S+)`", FIRST_DELIVERY.read_text())


IDS = names_of(pages())
TYPED = [path for path in reading_order() if any(block.typed or block.language == "python" for block in blocks(path))]
"""Pages with something to type."""
FIRST_DELIVERY = ROOT / "docs" / "tutorial" / "first-delivery.md"
NOWHERE = {
    "a weather service",
    "installs skyway",
    "a real vehicle",
    "PX4 itself",
    "ArduPilot itself",
    "needs a PostgreSQL server of yours",
    "needs a cluster of yours",
    "a fleet that processes of its own fly",  # tests/dispatch starts them
    "a firmware that is not there yet",
}
"""Why a block cannot be typed by a test."""
NOT_RUN = 17
REMEDY = "run: python tests/cli/docs_pages.py"


def type_everything(folder, *, flights):
    reader = Reader(folder, flights=flights)
    for each in reading_order():
        reader.type_page(each)


def test_the_documentation_typed_in_order_in_one_fresh_folder_works(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "skyway.link.telemetry.vehicle_monitor.ALONE_S", 0.0
    )  # nobody else is there; the slow test listens
    type_everything(tmp_path, flights=False)


@pytest.mark.slow
def test_the_documentation_typed_in_order_with_its_flights_works(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    type_everything(tmp_path, flights=True)


@pytest.mark.slow
@pytest.mark.parametrize("path", TYPED, ids=names_of(TYPED))
def test_a_page_typed_alone_works_after_the_pages_that_it_says_it_goes_on_with(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    reader = Reader(tmp_path)
    for earlier in pages_before(path):
        reader.type_page(earlier)
    reader.type_page(path)


def test_a_page_goes_on_with_earlier_pages_only_and_links_to_them():
    order = reading_order()
    for path in order:
        for earlier in pages_before(path):
            assert order.index(earlier) < order.index(path), path
        for name in re.findall(r"<!-- after: (\S+) -->", path.read_text()):
            link = f"({os.path.relpath(ROOT / 'docs' / name, path.parent)})"
            assert link in path.read_text().split("```")[0], f"{path}: no link to {name} before the first command"


def test_every_page_is_in_the_reading_order():
    assert sorted(reading_order()) == sorted(pages())


def test_only_what_can_be_run_nowhere_is_not_run():
    found = reasons_not_run()
    assert {reason for _, reason in found} <= NOWHERE, found
    assert len(found) == NOT_RUN, found


@pytest.mark.slow
@pytest.mark.parametrize("fault", tutorial_faults())
def test_a_fault_that_the_tutorial_proposes_falls_into_the_flight(fault, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    reader = Reader(tmp_path)
    for earlier in pages_before(FIRST_DELIVERY):
        reader.type_page(earlier)
    reader.type_faulty_flight(FIRST_DELIVERY, fault)


def test_the_page_of_commands_is_what_the_commands_say():
    assert PAGE.read_text() == page(), REMEDY


@pytest.mark.parametrize("path", pages(), ids=IDS)
def test_links_between_pages_lead_somewhere(path):
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", path.read_text()):
        if not target.startswith(("http:", "https:", "mailto:")):
            assert (path.parent / target).exists(), target


def test_the_citation_names_this_version_and_its_licence():
    cited, project = (
        yaml.safe_load((ROOT / "CITATION.cff").read_text()),
        tomllib.loads((ROOT / "pyproject.toml").read_text())["project"],
    )
    assert cited["version"] == project["version"]
    assert cited["license"] == project["license"]
    assert [one["name"] for one in cited["authors"]] == [one["name"] for one in project["authors"]]
    assert cited["repository-code"] == project["urls"]["Source"]
    assert {"cff-version", "message", "title"} <= cited.keys()


def test_pictures_of_the_documentation_are_small():
    for picture in (ROOT / "docs" / "assets").iterdir():
        assert picture.stat().st_size < 300_000


@pytest.mark.slow
def test_the_pages_build_without_a_warning(tmp_path):
    shutil.copy(ROOT / "mkdocs.yml", tmp_path)  # the site is written beside the file of its settings
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    (tmp_path / "skyway").symlink_to(ROOT / "skyway")
    command = [sys.executable, "-m", "zensical", "build", "--strict", "--clean"]
    found = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout
    start = (tmp_path / "site" / "index.html").read_text()
    assert not re.findall(r'(?:src|href)="https?://[^"]*\.(?:js|css|woff2?)', start)
