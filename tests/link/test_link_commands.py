"""The commands that speak with vehicles, against a simulated one on a TCP port."""

import json

import pytest
import typer
from sim_serving import served
from wires import a_mission

from link.autopilots import FAMILIES
from link.parameter_file import read_required
from missions import write
from missions.document import MissionDocument
from missions.parameters import Parameter, dumps
from models.errors import InputError, SkywayError
from skyway.cli import link_commands

app = typer.Typer()
link_commands.register(app)


@pytest.fixture
def run(tmp_path, capsys):
    def go(*words, port=None):
        where = [] if port is None else ["--connect", f"tcp:127.0.0.1:{port}"]
        try:
            code = app([*map(str, words), *where, "--record", str(tmp_path / "rec")], standalone_mode=False) or 0
        except SkywayError as error:
            return error.exit_code, str(error)
        return code, capsys.readouterr().out

    return go


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "m.plan"
    write(MissionDocument(a_mission(8)), path)
    return path


@pytest.mark.parametrize("family", sorted(FAMILIES))
def test_a_mission_is_shown_uploaded_verified_downloaded_and_cleared(run, plan, tmp_path, family):
    with served(tcp_port=0, autopilot=family) as there:
        port = there.where()[1]
        code, text = run("upload", plan, port=port)
        assert code == 0
        assert "nothing was sent; add --yes" in text
        assert run("verify", plan, port=port)[0] == 1
        code, text = run("upload", plan, "--yes", "--json", port=port)
        assert code == 0
        assert json.loads(text.splitlines()[-1])["parts"][0]["state"] == "verified"
        code, text = run("verify", plan, port=port)
        assert (code, text.strip()) == (0, "the vehicle holds what the file says")
        code, text = run("download", "-o", tmp_path / "back.plan", port=port)
        assert text.startswith("8 items, 0 fence areas, 0 rally points")
        assert run("clear", "--kind", "all", port=port)[0] == 0
        assert run("verify", plan, port=port)[0] == 0
        assert run("clear", "--kind", "all", "--yes", port=port)[0] == 0
        assert run("verify", plan, port=port)[0] == 1
    assert len(list((tmp_path / "rec").glob("*.tlog"))) == 9


def test_parameters_are_read_set_and_compared(run, tmp_path):
    with served(tcp_port=0, autopilot="ardupilot") as there:
        port = there.where()[1]
        code, text = run("params", "get", "RTL_ALT", port=port)
        assert text.startswith("RTL_ALT,")
        assert "would be set" in run("params", "set", "RTL_ALT", "6000", port=port)[1]
        assert run("params", "set", "RTL_ALT", "6000", "--yes", port=port)[1].endswith("-> 6000\n")
        file = tmp_path / "p.param"
        file.write_text("RTL_ALT,6000\n")
        assert run("params", "diff", file, port=port)[0] == 0
        file.write_text("RTL_ALT,5000\n# a comment\nNO_SUCH,1\n")
        code, text = run("params", "diff", file, port=port)
        assert code == 1
        assert "NO_SUCH: file 1, vehicle has none" in text


def test_a_mission_comes_with_the_parameters_it_needs(run, plan, tmp_path):
    needs = (
        Parameter("RTL_ALT", "at-least", 7000.0, "clears the ground"),
        Parameter("SYSID_MYGCS", "read", None, "ours"),
    )
    file = tmp_path / "m.param"
    file.write_text(dumps(needs))
    assert read_required(file) == needs
    with served(tcp_port=0, autopilot="ardupilot") as there:
        port = there.where()[1]
        assert "would be set to 7000" in run("upload", plan, "--parameters", file, port=port)[1]
        code, text = run("upload", plan, "--parameters", file, "--yes", port=port)
        assert code == 0
        assert "set to 7000" in text
        assert there.world.vehicles[1].autopilot.parameters["RTL_ALT"] == 7000.0


def test_watching_tells_what_is_known_and_what_is_not(run):
    with served(tcp_port=0, autopilot="px4") as there:
        code, text = run("watch", "--for", "4", "--json", port=there.where()[1])
    row = json.loads(text.splitlines()[-1])
    assert code == 0
    assert row["system"] == 1
    assert row["mode"] == "hold" or row["mode"]
    assert row["wind_mps"] is None
    assert row["soc"] > 0.9
    assert row["link"].endswith("%")


def test_nobody_there_ends_with_3_and_nonsense_with_2(run, plan, tmp_path):
    assert run("verify", plan, "--connect", "tcp:127.0.0.1:9")[0] == 3
    assert run("verify", plan, "--connect", "carrier pigeon")[0] == 2
    empty = tmp_path / "e.plan"
    write(MissionDocument(), empty)
    code, text = run("upload", empty)
    assert code == 2
    assert "holds nothing to upload" in text


def test_a_broken_parameter_file_names_its_line(tmp_path):
    file = tmp_path / "p.param"
    file.write_text("RTL_ALT,6000\nwhat is this\nX,nan\n")
    with pytest.raises(InputError, match=r"p.param:2: .*\n.*p.param:3"):
        read_required(file)
