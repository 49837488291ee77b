"""``skyway logs list`` and ``fetch``, typed, against simulated vehicles on TCP ports."""

import json

import pytest
from sim_serving import served

from skyway.cli.main import main

SIZES = (2_000, 20_000)


@pytest.fixture
def run(tmp_path, capsys):
    def go(there, *words):
        host, port = there.where()
        code = main(
            [*map(str, words), "--connect", f"tcp:{host}:{port}", "--system", "1", "--record", str(tmp_path / "rec")]
        )
        told = capsys.readouterr()
        return code, told.out, told.err

    return go


def content(there, number=-1):
    return bytes(list(there.world.vehicles[1].card.files.values())[number].content)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_logs_are_listed_and_fetched(run, autopilot, tmp_path):
    with served(tcp_port=0, autopilot=autopilot, logs=SIZES) as there:
        code, out, _ = run(there, "logs", "list")
        assert code == 0
        assert [line.split()[0] for line in out.splitlines()] == ["1", "2"]
        assert "20.0 kB" in out
        code, out, _ = run(there, "logs", "fetch", "all", "--to", tmp_path / "logs")
        assert code == 0, out
        assert out.count("verified by size and CRC-32") == 2
        files = sorted((tmp_path / "logs").glob("vehicle1-*"))
        assert [path.read_bytes() for path in files] == [content(there, 0), content(there, 1)]
        code, out, _ = run(there, "logs", "fetch", "2", "--to", tmp_path / "logs", "--json")
        assert code == 0
        (row,) = json.loads(out)["logs"]
        assert row["verified"] == "crc32"
        assert row["came_bytes"] == 0


@pytest.mark.parametrize("as_json", [False, True])
def test_a_log_that_fails_does_not_stop_the_others(run, as_json, tmp_path):
    with served(tcp_port=0, autopilot="px4", logs=SIZES) as there:
        assert run(there, "logs", "fetch", "1", "--to", tmp_path / "logs")[0] == 0
        (first,) = (tmp_path / "logs").glob("vehicle1-*")
        first.write_bytes(b"x" * SIZES[0])
        words = ["--json"] if as_json else []
        code, out, err = run(there, "logs", "fetch", "all", "--to", tmp_path / "logs", *words)
        assert code == 2
        assert "not fetched" in err.splitlines()[0]
        assert "differs from the vehicle's log" in err.splitlines()[0]
        assert "1 of 2 logs not fetched: " in err.splitlines()[-1]
        assert first.read_bytes() == b"x" * SIZES[0]
        (second,) = set((tmp_path / "logs").glob("vehicle1-*")) - {first}
        assert second.read_bytes() == content(there, 1)
        assert not as_json or [row["size_bytes"] for row in json.loads(out)["logs"]] == [SIZES[1]]


def test_times_come_with_log_requests_and_wrong_words_are_told(run, tmp_path):
    with served(tcp_port=0, autopilot="ardupilot", logs=SIZES) as there:
        code, out, _ = run(there, "logs", "list", "--by", "requests", "--json")
        told = json.loads(out)
        assert code == 0
        assert (told["by"], told["schema"]) == ("requests", "skyway.logs/1")
        assert [log["size_bytes"] for log in told["logs"]] == list(SIZES)
        assert all(log["time"] for log in told["logs"])
        code, _, err = run(there, "logs", "fetch", "7", "--to", tmp_path)
        assert code == 2
        assert "no such log" in err
        assert "1 to 2" in err
        (tmp_path / "file").write_text("")
        code, _, err = run(there, "logs", "fetch", "--to", tmp_path / "file")
        assert code == 2
        assert len(err.strip().splitlines()) == 1
    with served(tcp_port=0, autopilot="px4") as there:
        assert run(there, "logs", "list")[1] == "no logs\n"
        code, _, err = run(there, "logs", "fetch")
        assert code == 2
        assert "the vehicle has no logs" in err
