"""What every test may use."""

import json
import os
from pathlib import Path

import pytest

import build_kernels

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real measurements beside the project; tests that need it skip where it is absent."""
    folder = SHARED / "data"
    if not folder.is_dir():
        pytest.skip("the real data beside the project (../shared/data) is not here")
    return folder


@pytest.fixture(scope="session", autouse=True)
def kernels_are_listed():
    """Whatever Python code called a kernel with is in models/kernels.json: a wheel has machine code for it.

    With SKYWAY_KERNELS=FOLDER what was called is written there instead (``make kernels``).
    """
    yield
    called = build_kernels.observed()
    folder = os.environ.get("SKYWAY_KERNELS")
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
        (Path(folder) / f"{os.getpid()}.json").write_text(json.dumps(called))
        return
    listed = json.loads(build_kernels.LIST.read_text())
    missing = [name for name, kinds in called.items() if any(kind not in listed.get(name, []) for kind in kinds)]
    assert not missing, f"models/kernels.json does not list how these are called (run: make kernels): {missing}"
