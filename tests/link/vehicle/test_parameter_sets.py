"""``skyway params save`` and ``restore`` of sets, typed, against simulated vehicles on TCP ports."""

import json

import pytest
from sim_serving import served

from skyway.cli.main import main

CHANGED = {"px4": ("MPC_XY_CRUISE", 7.5), "ardupilot": ("RTL_ALT", 4200.0)}


@pytest.fixture
def run(tmp_path, capsys):
    def go(there, *words):
        where = ["--connect", f"tcp:127.0.0.1:{there.where()[1]}", "--system", "1", "--record", str(tmp_path / "rec")]
        code = main([*map(str, words), *where])
        told = capsys.readouterr()
        return code, told.out, told.err

    return go


@pytest.mark.parametrize("ending", ["param", "params"])
@pytest.mark.parametrize("autopilot", sorted(CHANGED))
def test_a_set_is_saved_shown_and_restored(run, tmp_path, autopilot, ending):
    file = tmp_path / f"before.{ending}"
    name, value = CHANGED[autopilot]
    with served(tcp_port=0, autopilot=autopilot) as there:
        store = there.world.vehicles[1].autopilot.parameters
        before = store[name]
        assert run(there, "params", "save", file)[0] == 0
        code, _, err = run(there, "params", "save", file)
        assert (code, "exists already" in err) == (2, True)
        assert run(there, "params", "diff", file)[0] == 0
        store.set(name, value)
        code, out, _ = run(there, "params", "restore", file)
        assert code == 0
        assert f"{name}: {value:.9g} -> {before:.9g}" in out
        assert "add --yes" in out
        assert store[name] == value
        code, out, _ = run(there, "params", "restore", file, "--yes", "--json")
        told = json.loads(out)
        assert (code, [row["done"] for row in told["parameters"]]) == (0, ["set"])
        assert store[name] == before


def test_unknown_contradicting_and_foreign_sets_are_told(run, tmp_path):
    with served(tcp_port=0, autopilot="px4") as there:
        file = tmp_path / "a.param"
        file.write_text("MPC_XY_CRUISE,6\nNO_SUCH,1\nMAV_SYS_ID,9\n")
        code, out, _ = run(there, "params", "restore", file, "--yes")
        assert code == 0
        assert "unknown to the vehicle: NO_SUCH" in out
        assert "MAV_SYS_ID is left as it is" in out
        assert there.world.vehicles[1].autopilot.parameters["MPC_XY_CRUISE"] == 6.0
        for text, fault in (
            ("RTL_ALT,1\n", "has none of its 1 parameters"),
            ("# Stack: ArduPilot\nMPC_XY_CRUISE,6\n", "is of another autopilot"),
            ("MPC_XY_CRUISE,6\nMPC_XY_CRUISE,7\n", "stands there twice"),
            ("MAV_SYS_ID,1.5\n", "is a whole number on the vehicle"),
            ("1\t100\tCAM,1\t1\t6\n", "is not a parameter"),
            ("1\t100\tCAM\t1\t6\n", "holds no parameters"),
        ):
            file.write_text(text)
            code, _, err = run(there, "params", "restore", file, "--yes")
            assert (code, fault in err, len(err.strip().splitlines())) == (2, True, 1), err


def test_a_renamed_parameter_is_restored_under_its_new_name(run, tmp_path):
    file = tmp_path / "old.param"
    file.write_text("RTL_ALT,4200\n")
    with served(tcp_port=0, autopilot="ardupilot", firmware="4.8") as there:
        code, out, _ = run(there, "params", "restore", file, "--yes")
        assert code == 0, out
        assert "RTL_ALT is called RTL_ALT_M on the vehicle" in out
        assert "-> 42" in out
