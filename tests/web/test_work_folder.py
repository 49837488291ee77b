"""The work folder: nothing leads out of it."""

from __future__ import annotations

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from skyway.models.base.errors import InputError
from skyway.web.folder import Folder, safe_name


@pytest.mark.parametrize(
    "name",
    [
        "",
        ".",
        "..",
        "../secret",
        "a/../../secret",
        "/etc/passwd",
        "a\0b",
        "C:\\x",
        "..\\secret",
        "link/secret",
        "x" * 300,
        "\u6f22" * 100,  # 300 bytes
        "x/" * 2000 + "x",
        "\ud800",
    ],
)
def test_no_name_leads_out_of_the_folder(tmp_path, name):
    (tmp_path / "secret").write_text("no")
    root = tmp_path / "work"
    root.mkdir()
    (root / "link").symlink_to(tmp_path)
    folder = Folder(root)
    with pytest.raises(InputError):
        folder.existing(name)
    with pytest.raises((InputError, OSError)):
        folder.write(name, b"x")
    assert [one.name for one in folder.files("")] == []


@settings(max_examples=60)
@given(st.text(max_size=200))
@example("\u6f22" * 200 + ".plan")
@example("\U0001d7d8" * 115 + ".plan")
@example("\ud800.plan")
def test_the_name_of_any_upload_becomes_a_plain_name(name):
    kept = safe_name(name)
    assert kept
    assert len(kept) <= 120
    assert len(kept.encode()) <= 180
    assert kept.endswith(".plan") or not name.endswith("\u6f22.plan")
    assert "/" not in kept
    assert not kept.startswith(".")
    assert kept.isprintable()


def test_files_are_listed_newest_first_and_numbered_where_the_name_is_taken(tmp_path):
    import os

    folder = Folder(tmp_path)
    (tmp_path / "deep").mkdir()
    for number, name in enumerate(("b.plan", "deep/a.PLAN", "c.txt", ".hidden.plan")):
        (tmp_path / name).write_text("{}")
        os.utime(tmp_path / name, (number, number))
    assert [one.name for one in folder.files(".plan")] == ["deep/a.PLAN", "b.plan"]
    assert folder.free_name("x/b.plan") == "b-2.plan"
    folder.write("b-2.plan", b"1")
    with pytest.raises(InputError, match="exists"):
        folder.write("b-2.plan", b"2")


def test_files_that_belong_together_are_numbered_together(tmp_path):
    folder = Folder(tmp_path)
    assert folder.free_names(["a.plan", "a.params"]) == ["a.plan", "a.params"]
    (tmp_path / "a.params").write_text("")
    assert folder.free_names(["a.waypoints", "a.fence.waypoints", "a.params"]) == [
        "a-2.waypoints",
        "a-2.fence.waypoints",
        "a-2.params",
    ]


def test_a_wheel_holds_every_file_of_the_page():
    import tomllib
    from fnmatch import fnmatch
    from pathlib import Path

    root = Path(__file__).parents[2]
    patterns = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]["skyway.web"]
    files = [
        one.relative_to(root / "skyway/web").as_posix()
        for one in (root / "skyway/web/static").rglob("*")
        if one.is_file()
    ]
    depth = {pattern: pattern.count("/") for pattern in patterns}
    assert files
    assert [one for one in files if not any(fnmatch(one, p) and one.count("/") == depth[p] for p in patterns)] == []
