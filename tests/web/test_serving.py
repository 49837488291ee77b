"""The served page over HTTP, as a person's browser and as an attacker would ask it; no browser is needed."""

from __future__ import annotations

import contextlib
import http.client
import json
import shlex
import subprocess
import sys

import msgspec
import pytest

from skyway.cli.main import main
from skyway.web.work.question import Question
from tests.web.conftest import ROOT

HTML = {"Accept": "text/html"}


def test_the_page_answers_with_everything_from_itself(page):
    status, headers, text = page.ask("/", **HTML)
    assert status == 200
    assert "nonce-" in headers["content-security-policy"]
    assert "server" not in headers
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert "https://" not in text
    scripts = text.count("<script")
    assert scripts == text.count('<script nonce="') > 5
    for path in ("/static/page.css", "/static/page.js", "/static/map/index.js"):
        assert page.ask(path)[0] == 200


def test_the_map_gets_stations_wind_and_queues(page):
    region = json.loads(page.ask("/api/region")[2])
    wind = json.loads(page.ask("/api/wind?depart=2013-07-10T14:00-04:00")[2])
    queues = json.loads(page.ask("/api/queues?depart=2013-07-10T14:00-04:00")[2])
    assert len(region["stations"]) == 46
    assert len(wind["hours"]) == 24
    assert len(wind["hours"][0]["north"]) == len(wind["hours"][0]["spread"]) == len(wind["points"])
    assert 0.5 < min(wind["hours"][6]["spread"]) < 10.0
    sure = json.loads(page.ask("/api/wind?depart=2013-07-10T14:00-04:00&wind=8@270")[2])
    assert set(sure["hours"][0]["spread"]) == {0.0}
    assert set(queues["stations"]) == {one["id"] for one in region["stations"] if one["pads"]}
    status, _, text = page.ask("/api/wind?depart=soon")
    assert status == 422
    assert "--depart" in json.loads(text)["error"]


@pytest.mark.parametrize(
    ("status", "path", "asked"),
    [
        (404, "/static/../../../pyproject.toml", {}),
        (404, "/static/%2e%2e/%2e%2e/server.py", {}),
        (404, "/static//etc/passwd", {}),
        (404, "/api/files/..%2F..%2Fetc%2Fpasswd", {}),
        (404, "/<script>alert(1)</script>", {}),
        (404, "/openapi.json", {}),
        (404, "/docs", {}),
        (403, "/", {"Host": "evil.example"}),
        (403, "/_nicegui/client/x/upload/1", {"method": "POST", "body": b"x", "Origin": "http://evil.example"}),
        (413, "/_nicegui/client/x/upload/1", {"method": "POST", "Content_Length": str(2**33), "body": b""}),
        (400, "/_nicegui_ws/socket.io/?EIO=4&transport=polling", {}),
        (404, "/api/region", {"method": "POST", "body": b"", "own": True}),
    ],
)
def test_attacks_are_refused(page, status, path, asked):
    own = {"Origin": page.address} if asked.pop("own", False) or asked.get("Content_Length") else {}
    found, headers, text = page.ask(path, **asked, **own)
    assert found == status
    assert "root:" not in text
    assert "<script>alert" not in text
    assert headers["x-content-type-options"] == "nosniff"


def test_uploads_land_in_the_work_folder_under_plain_names_and_nowhere_else(page):
    own = {"Origin": page.address}
    before = {one.name for one in page.folder.iterdir()}
    asked = [
        (200, "mission.plan", "mission.plan"), (200, "mission.plan", "mission-2.plan"), (200, "../../evil.plan", "evil.plan"),
        (200, "%3Cscript%3E.plan", "_script_.plan"), (415, "page.html", None), (415, "plan.plan.exe", None), (415, "", None),
    ]  # fmt: skip
    for status, name, kept in asked:
        found, _, text = page.ask(f"/api/upload?name={name}", "POST", b"{}", **own)
        assert found == status, name
        assert kept is None or json.loads(text)["name"] == kept
    assert page.ask("/api/upload?name=x.plan", "POST", b"{}")[0] == 403
    assert sorted({one.name for one in page.folder.iterdir()} - before) == [
        "_script_.plan",
        "evil.plan",
        "mission-2.plan",
        "mission.plan",
    ]
    assert not (page.folder.parent / "evil.plan").exists()
    assert page.ask("/api/replay?log=../secret.tlog")[0] == 404
    assert page.ask("/api/replay?log=mission.plan")[0] == 422
    assert page.ask("/api/report?journal=../secret.jsonl")[0] == 404
    assert page.ask("/api/report?journal=mission.plan")[0] == 422
    for path in ("/missions?file=%3Cscript%3E1", "/fly", "/replay?log=%3Cscript%3E1", "/history"):
        status, _, text = page.ask(path, **HTML)
        assert status == 200
        assert "<script>1" not in text


def test_a_page_asked_for_with_a_script_in_its_question_shows_it_as_text(page):
    _, _, text = page.ask("/?start=%3Cscript%3Ealert(1)%3C/script%3E&avoid=%60%24%7Balert(1)%7D&nonsense=1", **HTML)
    assert "<script>alert" not in text
    assert "${alert" not in text


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--host", "0.0.0.0"], "others can reach this address"),
        (["--host", "0.0.0.0", "--token", "short"], "too short"),
        (["--folder", "/nowhere/at/all"], "no such folder"),
        (["--port", "70000"], "out of range"),
    ],
)
def test_what_is_not_safe_is_not_served(capsys, options, said):
    assert main(["serve", *options]) == 2
    assert said in capsys.readouterr().err


def test_without_its_extra_the_page_names_it():
    code = "import sys; sys.modules['uvicorn'] = None; from skyway.cli.main import main; sys.exit(main(['serve', '--port', '0']))"
    found = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False, timeout=60
    )
    assert found.returncode == 2
    assert (
        found.stderr.strip() == "skyway: this needs uvicorn, which is not installed: pip install 'skyway-planner[web]'"
    )


def test_the_command_shown_gives_the_plan_shown(capsys, tmp_path):
    from skyway.web.work.planned import plan

    question = Question(
        start="bellevue", to="40.9,-73.9", payload="1,2", depart="2013-07-10T14:00-04:00", wind="6@250", reserve="25", drone="m300",
        others=("pfs",),
    )  # fmt: skip
    shown = plan(None, msgspec.to_builtins(question))
    for command, figures in zip(shown["commands"], shown["plans"], strict=True):
        words = [one for one in shlex.split(command) if one not in {"skyway", "--explain"}]
        assert main([*words, "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["arrival"]["delivery_mean_s"]["value"] == figures["mean_s"]
        assert told["planner"] == figures["planner"]
        assert [stop["station"] for stop in told["stops"]] == figures["stops"]
        assert told["reserve_soc"] == figures["reserve_soc"] == 0.25


def test_without_a_base_map_there_are_no_tiles(page):
    assert page.ask("/api/base")[2] == "{}"
    assert page.ask("/api/tile?z=1&x=0&y=0")[0] == 204
    assert page.ask("/api/tile?z=a&x=0&y=0")[0] == 422


@pytest.mark.slow
def test_a_file_of_unknown_length_is_refused_where_it_grows_too_large(page):
    piece = b"a" * 2**20
    before = set(page.folder.iterdir())
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", page.port, timeout=60)) as connection:
        connection.putrequest("POST", "/api/upload?name=large.tlog")
        for name, value in (("Origin", page.address), ("Transfer-Encoding", "chunked")):
            connection.putheader(name, value)
        connection.endheaders()
        with contextlib.suppress(ConnectionError):
            for _ in range(80):
                connection.send(f"{len(piece):x}\r\n".encode() + piece + b"\r\n")
        assert connection.getresponse().status == 413
    assert set(page.folder.iterdir()) == before
