"""The documentation is true: every command and program it shows runs, every output is what comes out."""

import re
import subprocess
import sys

import pytest
from command_reference import PAGE, page
from docs_pages import OUTPUT, ROOT, blocks, pages, run, shape

IDS = [str(path.relative_to(ROOT)) for path in pages()]
REMEDY = "run: python tests/cli/docs_pages.py"


@pytest.mark.parametrize("path", pages(), ids=IDS)
def test_every_command_of_a_page_runs_and_prints_what_the_page_shows(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    last = ""
    for block in blocks(path):
        if block.mark == OUTPUT:
            assert shape(last) == shape(block.text), REMEDY
        for command in block.commands:
            code, last, err = run(command)
            assert code == 0, f"{command}: {err}"


@pytest.mark.parametrize("path", pages(), ids=IDS)
def test_every_program_of_a_page_runs(path, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks(path):
        if block.language == "python":
            exec(compile(block.text, str(path), "exec"), names)


def test_the_page_of_commands_is_what_the_commands_say():
    assert PAGE.read_text() == page(), REMEDY


@pytest.mark.parametrize("path", pages(), ids=IDS)
def test_links_between_pages_lead_somewhere(path):
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", path.read_text()):
        if not target.startswith(("http:", "https:", "mailto:")):
            assert (path.parent / target).exists(), target


def test_pictures_of_the_documentation_are_small():
    for picture in (ROOT / "docs" / "assets").iterdir():
        assert picture.stat().st_size < 300_000


def test_the_pages_build_without_a_warning(tmp_path):
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    start = (tmp_path / "site" / "index.html").read_text()
    assert not re.findall(r'(?:src|href)="https?://(?!squidfunk)[^"]*\.(?:js|css|woff2?)', start)
