"""The floors are parts of the package skyway: nobody imports a folder of the checkout by its bare name."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
FLOORS = ("models", "planner", "missions", "link", "sim_stub")
BARE = re.compile(rf"^\s*(?:from ({'|'.join(FLOORS)})[. ]|import ({'|'.join(FLOORS)})\b)", re.MULTILINE)


def test_no_module_imports_a_floor_by_its_bare_name():
    files = [path for folder in (*FLOORS, "skyway", "tests", "benchmarks") for path in (ROOT / folder).rglob("*.py")]
    assert not [str(path) for path in files if BARE.search(path.read_text(encoding="utf-8"))]


def test_a_host_with_folders_of_the_same_names_does_not_disturb(tmp_path):
    for name in FLOORS:
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(f"raise RuntimeError('the host\\'s own {name}')\n")
    program = (
        f"import sys; sys.path[:0] = [r'{tmp_path}', r'{ROOT}']; import skyway; "
        "print(repr(skyway.read_scenario(str(skyway.NEW_YORK)))); import skyway.planner.plan; "
        "from skyway import missions, sim_stub; from skyway.link import supervisor; "
        "[getattr(part, name) for part in (missions, sim_stub, supervisor) for name in part.__all__]"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False, env={}
    )
    assert done.returncode == 0, done.stderr
    assert "46 stations" in done.stdout
