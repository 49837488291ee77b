"""Flights in processes of their own, as the page finds, tells and orders them; no browser and no flight is needed."""

from __future__ import annotations

import gc
import json
import os
import time
import weakref

import msgspec
import pytest

from skyway.flights.live import Live, read_live
from skyway.flights.starting import FlightOptions, channel, resumed, start
from skyway.link.supervisor.command.request_file import Request, RequestFile, request
from skyway.models.base.errors import InputError
from skyway.web.folder import Folder
from skyway.web.guard import BROWSER, browser
from skyway.web.live.flights import Flights
from skyway.web.live.journal_tail import LONGEST, JournalTail
from tests.web.browsing import chromium, person
from tests.web.conftest import ROOT

NAME = "2026-01-01-a-b"


def written(folder, **more):
    live = Live(
        pid=os.getpid(), words=["fly", "a"], journal=f"{NAME}.jsonl", wall_s=time.time(), state="flying", **more
    )
    (folder / f"{NAME}.live").write_bytes(msgspec.json.encode(live))
    return live


def record(number, event, state="flying", **data):
    return json.dumps(
        {
            "n": number,
            "time": f"2026-01-01T00:00:{number:02d}Z",
            "state": state,
            "event": event,
            "reason": f"r{number}",
            "data": data,
        }
    )


def test_flights_are_found_by_their_files_whoever_started_them(tmp_path):
    flights = Flights(Folder(tmp_path))
    assert flights.digest() == []
    written(tmp_path, vehicle={"lat": 1.0, "lon": 2.0}, origin="a", destination="b")
    (tmp_path / "other.live").write_text("nonsense")
    (tmp_path / "link.live").symlink_to(tmp_path / f"{NAME}.live")
    again = Flights(Folder(tmp_path))
    (row,) = again.digest()
    assert (row["name"], row["state"], row["silent"], row["ended"]) == (NAME, "flying", False, False)
    told = again.told(NAME, 0, "me")
    assert told["runs"]
    assert not told["mine"]
    assert told["live"]["words"] == []
    with pytest.raises(InputError, match="no such flight"):
        again.told("../secret", 0, "me")


def test_a_journal_is_followed_line_by_line_also_while_a_line_is_half_written(tmp_path):
    path = tmp_path / f"{NAME}.jsonl"
    tail = JournalTail(path)
    tail.read()
    lines = [
        record(1, "decision", action="divert"), record(2, "track", lat=1.0, lon=2.0, soc=0.5), "nonsense",
        record(3, "text", text="<b>x</b>", severity="error"), record(4, "order", word="pause", done="taken", id="q"), record(5, "check"),
    ]  # fmt: skip
    text = "\n".join(lines) + "\n"
    for cut in range(0, len(text), 37):
        path.write_text(text[:cut])
        tail.read()
    path.write_text(text)
    tail.read()
    told = tail.since(0)
    assert [row["n"] for row in told["rows"]] == [1, 3, 4]
    assert told["rows"][1]["text"] == "<b>x</b>"
    assert (told["last"], tail.course()[0]) == (5, [1.0, 2.0])
    assert [row["n"] for row in tail.since(3)["rows"]] == [4]
    path.write_text(record(1, "state") + "\n")  # another one in its place
    tail.read()
    assert [row["n"] for row in tail.since(0)["rows"]] == [1]


def test_a_journal_of_lines_without_end_is_not_kept_in_memory(tmp_path):
    path = tmp_path / f"{NAME}.jsonl"
    tail = JournalTail(path)
    with path.open("wb") as file:
        for _ in range(3):
            file.write(b"x" * (5 * 2**20))
            file.flush()
            tail.read()
        file.write(f"\n{record(1, 'state')}\n".encode())
    for _ in range(5):
        tail.read()
    assert [row["n"] for row in tail.since(0)["rows"]] == [1]
    assert max(len(value) for value in vars(tail).values() if isinstance(value, bytes)) <= LONGEST


def test_one_flight_whose_files_lie_hides_no_other(tmp_path):
    written(tmp_path, vehicle={"lat": 1.0, "lon": 2.0})
    lies = {
        "vehicle": {"lat": "<b>", "lon": [1], "course_deg": {}},
        "leg": {"way": 5, "to": 7},
        "holder": {},
        "pid": 10**18,
    }
    ways = [5, [[1.0]], [[1.0, 2.0], ["a", "b"], [None, 1], {}], "ab"]
    for number, way in enumerate(ways):
        told = lies | {"leg": {"way": way}, "wall_s": -1e300}
        (tmp_path / f"lies-{number}.live").write_text(json.dumps(told))
    for name in ("out", "fifo"):
        (tmp_path / f"{name}.live").write_text(json.dumps(lies))
    (tmp_path / "out.jsonl").symlink_to("/etc/passwd")
    os.mkfifo(tmp_path / "fifo.jsonl")  # nobody will ever write into it
    found = {row["name"]: row for row in Flights(Folder(tmp_path)).digest()}
    assert found.keys() == {NAME, *(f"lies-{number}" for number in range(len(ways)))}
    assert (found[NAME]["vehicle"]["lat"], found["lies-0"]["vehicle"]["lat"]) == (1.0, None)
    assert [found[f"lies-{number}"]["way"] for number in range(len(ways))] == [[], [], [[1.0, 2.0]], []]


def test_orders_and_outputs_are_written_through_no_link(tmp_path):
    precious = tmp_path / "precious"
    precious.write_text("mine")
    for ending in (".orders", ".out"):
        (tmp_path / f"{NAME}{ending}").symlink_to(precious)
    order = Request(id="12345678", word="pause", who="a", name="b", time_s=0.0)
    with pytest.raises(InputError, match="cannot be written"):
        request(tmp_path / f"{NAME}.orders", order)
    with pytest.raises(InputError, match="cannot be written"):
        RequestFile(tmp_path / f"{NAME}.orders", lambda _: None)
    with pytest.raises(InputError, match="cannot be written"):
        start(["--version"], tmp_path / f"{NAME}.out")
    assert precious.read_text() == "mine"


def test_what_is_known_of_a_flight_is_forgotten_with_it(tmp_path, monkeypatch):
    monkeypatch.setattr("skyway.web.live.flights.LOOK_S", -1.0)
    flights = Flights(Folder(tmp_path))
    written(tmp_path)
    (tmp_path / f"{NAME}.jsonl").write_text(record(1, "track", lat=1.0, lon=2.0) + "\n")
    assert flights.digest()[0]["track"] == [[1.0, 2.0]] * 2
    held = [weakref.ref(one) for one in gc.get_objects() if isinstance(one, JournalTail)]
    (tmp_path / f"{NAME}.live").unlink()
    assert flights.digest() == []
    gc.collect()
    assert held
    assert [one for one in held if one() is not None] == []


def test_an_order_reaches_the_flight_with_who_gave_it_and_only_from_a_browser_that_has_opened_the_page(page):
    written(page.folder)
    heard = RequestFile(page.folder / f"{NAME}.orders", lambda _: None)
    order = {"flight": NAME, "id": "0123456789", "word": "pause", "name": "Anna"}
    own = {"Origin": page.address, "Cookie": f"{BROWSER}={'x' * 32}"}

    def sent(body, **headers):
        return page.ask(
            "/api/order", "POST", body if isinstance(body, bytes) else json.dumps(body).encode(), **headers
        )[0]

    time.sleep(0.5)
    assert sent(order, **own) == 200
    said = heard.next_input()
    assert (said.word, said.name, said.id, said.who) == (
        "pause",
        "Anna",
        "0123456789",
        browser({"cookie": own["Cookie"]}),
    )
    for status, body, headers in [
        (403, order, {"Origin": page.address}),
        (403, order, {"Cookie": own["Cookie"]}),
        (403, order, {"Cookie": own["Cookie"], "Origin": "http://evil.example"}),
        (422, b"{", own), (422, {**order, "id": "../x"}, own), (422, {**order, "word": "x" * 101}, own), (422, {**order, "who": "b"}, own),
        (422, [order], own), (409, {**order, "flight": "../../etc/passwd"}, own), (409, {**order, "flight": "nobody"}, own),
    ]:  # fmt: skip
        assert sent(body, **headers) == status, (body, headers)
    assert page.ask("/api/order", Cookie=own["Cookie"])[0] in {404, 405}
    assert heard.next_input() is None
    assert page.ask("/api/flight?name=../x&seen=-1")[0] == 404
    assert json.loads(page.ask(f"/api/flight?name={NAME}&seen=99999999999999999999")[2])["name"] == NAME
    for ending in ("live", "orders"):
        (page.folder / f"{NAME}.{ending}").unlink()


def test_each_browser_gets_a_session_of_its_own(page):
    cookies = [page.ask("/fly", Accept="text/html")[1]["set-cookie"] for _ in range(2)]
    assert cookies[0] != cookies[1]
    for cookie in cookies:
        assert cookie.startswith(f"{BROWSER}=")
        assert "HttpOnly" in cookie
        assert "SameSite=Strict" in cookie
    assert "set-cookie" not in page.ask("/fly", Accept="text/html", Cookie=cookies[0].split(";")[0])[1]
    assert browser({"cookie": "x=1"}) == browser({"cookie": f"{BROWSER}=short"}) == ""


def test_the_command_of_a_flight_is_that_of_a_person_and_is_continued_only_if_it_was_begun_here(tmp_path):
    options = FlightOptions(
        plan="p.json",
        connect="tcp:127.0.0.1:5760",
        pads="manual",
        drag="d.toml",
        each=True,
        keep=True,
        release="hand",
        elevation="target=34, roof=12.5",
    )
    assert options.words() == [
        "fly", "p.json", "--connect", "tcp:127.0.0.1:5760", "--pads", "manual", "--drag", "d.toml", "--elevation", "target=34", "--elevation", "roof=12.5",
        "--release", "hand", "--manual", "--keep-parameters",
    ]  # fmt: skip
    for wrong in ({"plan": ""}, {"connect": ""}, {"connect": "--yes"}, {"drag": "-x"}):
        with pytest.raises(InputError):
            FlightOptions(**({"plan": "p.json", "connect": "tcp:x:1"} | wrong)).words()
    journal = tmp_path / "j.jsonl"
    words = [*options.words(), *channel(journal)]
    assert "--resume" in resumed(words, journal)
    assert "--journal" not in resumed(words, journal)
    assert resumed(resumed(words, journal), journal) == resumed(words, journal)
    for other in (["sim"], [], ["fly", "x"], ["plan", "--journal", str(journal)]):
        with pytest.raises(InputError, match="not started here"):
            resumed(other, journal)


@pytest.mark.slow
def test_a_name_stays_while_it_is_typed(page):
    written(page.folder)
    with chromium() as here, person(here, page.address, f"/fly?flight={NAME}") as tab:
        tab.wait_for_selector("#my-name")
        tab.focus("#my-name")
        tab.keyboard.type("Ana")
        for _ in range(2):  # what is shown is drawn again with each
            with tab.expect_response("**/api/fleet"):
                pass
        tab.keyboard.type("bel")
        assert tab.input_value("#my-name") == "Anabel"
    for file in page.folder.glob(f"{NAME}.*"):
        file.unlink()


@pytest.mark.slow
def test_a_flight_that_cannot_begin_tells_why_where_the_page_looks(skyway_fly, tmp_path):
    answer = skyway_fly("fly", "plan.json", "--connect", "udpin:127.0.0.1:0", "--orders", "f.txt")
    assert answer == 2
    answer = skyway_fly("fly", "plan.json", "--connect", "tcp:127.0.0.1:1", "--orders", str(tmp_path / "f.orders"))
    assert answer != 0
    live = read_live(tmp_path / "f.live")
    assert live.ended
    assert live.problem
    assert (tmp_path / "f.orders").exists()


@pytest.fixture
def skyway_fly(tmp_path, monkeypatch):
    from skyway.cli.main import main

    monkeypatch.chdir(tmp_path)
    plan = [
        "plan",
        "--from",
        "bellevue",
        "--to",
        "city-hall",
        "--payload",
        "0.8",
        "--planner",
        "shortest",
        "--wind",
        "2@250",
        "-o",
        "plan.json",
    ]
    assert main(plan) == 0
    assert ROOT.is_dir()
    return lambda *words: main(list(words))
