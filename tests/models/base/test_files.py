"""Files at the edge: whole or not at all, within bounds, and every failure one clear line."""

import contextlib
import gzip
import os
import stat
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.base import files
from skyway.models.base.errors import InputError
from skyway.models.base.fields import finite, read_toml
from skyway.models.base.files import read_bytes, read_text, write_atomically

LIMIT = 64 * 1024 * 1024


def test_a_file_comes_back_as_it_was_written(tmp_path):
    path = tmp_path / "plan.json"
    write_atomically(path, "Zürich\n")
    assert read_text(path, max_bytes=LIMIT) == "Zürich\n"
    assert [p.name for p in tmp_path.iterdir()] == ["plan.json"]


def test_nothing_is_overwritten_without_force(tmp_path):
    path = tmp_path / "plan.json"
    path.write_text("old")
    with pytest.raises(InputError, match=r"plan\.json: exists already; .*--force"):
        write_atomically(path, "new")
    assert path.read_text() == "old"
    write_atomically(path, b"new", force=True)
    assert path.read_text() == "new"


def test_a_written_file_has_the_rights_of_any_other(tmp_path):
    mask = os.umask(0o027)
    try:
        write_atomically(tmp_path / "plan.json", "x")
    finally:
        os.umask(mask)
    assert stat.S_IMODE((tmp_path / "plan.json").stat().st_mode) == 0o640


@pytest.mark.parametrize("name", ["no/such/folder/plan.json", "x" * 300])
def test_what_cannot_be_written_is_said_and_leaves_nothing_behind(tmp_path, name):
    with pytest.raises(InputError, match="cannot be written"):
        write_atomically(tmp_path / name, "x")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_not_replaced_by_a_file(tmp_path):
    (tmp_path / "plan.json").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        write_atomically(tmp_path / "plan.json", "x", force=True)
    assert [p.name for p in tmp_path.iterdir()] == ["plan.json"]


def test_packed_files_are_unpacked_within_the_limit(tmp_path):
    path = tmp_path / "a.csv.gz"
    path.write_bytes(gzip.compress(b"id,lat,lon\n"))
    assert read_bytes(path, max_bytes=11) == b"id,lat,lon\n"
    path.write_bytes(gzip.compress(bytes(20_000_000)))
    with pytest.raises(InputError, match="is larger than 1 MB"):
        read_bytes(path, max_bytes=1_000_000)


@pytest.mark.parametrize("keep", [5, 30, -1])
def test_a_damaged_packed_file_is_said_to_be_one(tmp_path, keep):
    path = tmp_path / "a.csv.gz"
    data = bytearray(gzip.compress(b"id,lat,lon\n" * 100))
    path.write_bytes(bytes(data[:keep]))
    with pytest.raises(InputError, match=r"a\.csv\.gz: cannot be read"):
        read_bytes(path, max_bytes=LIMIT)


@given(place=st.integers(0, 60), byte=st.integers(0, 255))
def test_no_damage_to_a_packed_file_crashes(tmp_path_factory, place, byte):
    path = tmp_path_factory.mktemp("gz") / "a.gz"
    data = bytearray(gzip.compress(b"id,lat,lon\nabc,40.7,-74\n" * 5))
    data[place % len(data)] = byte
    path.write_bytes(bytes(data))
    with contextlib.suppress(InputError):
        read_bytes(path, max_bytes=10_000)


def test_a_missing_file_a_folder_and_a_circle_of_links_are_told_apart(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_bytes(tmp_path / "nowhere.csv", max_bytes=LIMIT)
    with pytest.raises(InputError, match="is a folder"):
        read_bytes(tmp_path, max_bytes=LIMIT)
    (tmp_path / "loop.csv").symlink_to(tmp_path / "loop.csv")
    with pytest.raises(InputError, match=r"cannot be read: .*symbolic link"):
        read_bytes(tmp_path / "loop.csv", max_bytes=LIMIT)
    with pytest.raises(InputError, match="cannot be read"):
        read_bytes(tmp_path / "a\0b.csv", max_bytes=LIMIT)


def test_a_link_to_a_file_is_as_good_as_the_file(tmp_path):
    (tmp_path / "a.csv").write_text("x")
    (tmp_path / "b.csv").symlink_to("a.csv")
    assert read_text(tmp_path / "b.csv", max_bytes=LIMIT) == "x"


def test_200_megabytes_are_refused(tmp_path):
    path = tmp_path / "huge.csv"
    with path.open("wb") as stream:
        stream.truncate(200_000_000)
    with pytest.raises(InputError, match=r"huge\.csv: is larger than 67 MB; cut it"):
        read_text(path, max_bytes=LIMIT)


def test_a_byte_order_mark_is_dropped(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"\xef\xbb\xbfid,lat\r\n")
    assert read_text(tmp_path / "a.csv", max_bytes=LIMIT) == "id,lat\r\n"


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        ("Spital Zürich".encode("latin-1"), r"is not UTF-8 text \(byte 8\); save it with the encoding UTF-8"),
        ("id,lat".encode("utf-16"), "is UTF-16 text; save it with the encoding UTF-8"),
        (b"id,l\0at", "is not text: byte 4 is NUL"),
    ],
)
def test_what_is_no_utf8_text_is_refused(tmp_path, data, problem):
    (tmp_path / "a.csv").write_bytes(data)
    with pytest.raises(InputError, match=problem):
        read_text(tmp_path / "a.csv", max_bytes=LIMIT)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("name = \nb = 1", r"s\.toml:1: is not TOML: Invalid value"),
        ("a = 1\na = 2\n", r"s\.toml:2: is not TOML: Cannot overwrite"),
        ("a = " + "9" * 5000, "is not TOML"),
        ("a = " + "[" * 100_000, "is nested too deeply"),
        ("a = " + "{b = " * 5000, "is nested too deeply"),
        ("a" + ".a" * 200_000 + " = 1", "is nested too deeply"),
        ("['a'" + ".'b'" * 50_000 + "]", "is nested too deeply"),
        ('"a"' + ' . "\\""' * 50_000 + " = 1", "is nested too deeply"),
        ("a = {b" + ".b" * 100_000 + " = 1}", "is nested too deeply"),
        ("#" * 1_100_000, "is larger than 1 MB"),
    ],
)
def test_hostile_toml_is_refused_before_it_eats_the_machine(tmp_path, text, problem):
    (tmp_path / "s.toml").write_text(text)
    with pytest.raises(InputError, match=problem):
        read_toml(tmp_path / "s.toml")


def test_toml_from_any_editor_is_read(tmp_path):
    (tmp_path / "s.toml").write_bytes(b"\xef\xbb\xbf# ...........................................\r\na.b = 1.5\r\n")
    assert read_toml(tmp_path / "s.toml") == {"a": {"b": 1.5}}


@pytest.mark.parametrize(
    ("text", "number"),
    [
        *[("40.7", 40.7), (" -74 ", -74.0), ("1e3", 1000.0), (3, 3.0)],
        *[(wrong, None) for wrong in ("nan", "inf", "40,7", "", "1_000", "0x10", True, None, 10**400, [1])],
    ],
)
def test_only_a_finite_number_is_a_number(text, number):
    assert finite(text) == number


def test_a_pipe_is_read_to_its_end_and_refused_if_nothing_writes_into_it(tmp_path, monkeypatch):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    monkeypatch.setattr(files, "PIPE_S", 0.2)
    with pytest.raises(InputError, match=r"pipe: is a pipe into which nothing writes within 0\.2 s; start what writes"):
        read_bytes(path, max_bytes=LIMIT)
    monkeypatch.setattr(files, "PIPE_S", 20.0)
    writer = threading.Thread(target=path.write_bytes, args=(b"KEWR 101751Z 27016KT\n" * 10_000,))
    writer.start()
    assert len(read_bytes(path, max_bytes=LIMIT)) == 210_000
    writer.join()
