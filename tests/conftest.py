"""What every test may use."""

import json
import os
from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real measurements beside the project; tests that need it skip where it is absent."""
    folder = SHARED / "data"
    if not folder.is_dir():
        pytest.skip("the real data beside the project (../shared/data) is not here")
    return folder


@pytest.fixture(scope="session", autouse=True)
def kernels_called():
    """With SKYWAY_KERNELS=FOLDER, what Python code called kernels with is written there (``make kernels``)."""
    yield
    folder = os.environ.get("SKYWAY_KERNELS")
    if folder:
        import build_kernels

        Path(folder).mkdir(parents=True, exist_ok=True)
        (Path(folder) / f"{os.getpid()}.json").write_text(json.dumps(build_kernels.observed()))
