"""What every test may use."""

import gc
import json
import os
from pathlib import Path

import pytest
from hypothesis import settings

os.environ.setdefault(
    "OPENBLAS_NUM_THREADS", "1"
)  # as on the command line (skyway/cli/__init__.py); read when numpy is imported

# No deadline, since kernels compile on their first call. `make test` draws the same examples at each run, so that it says of a commit what it
# said before; `make explore` draws others.
settings.register_profile("same", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=300)
settings.load_profile("same")

CALL_NO_KERNEL = frozenset(
    f"test_{name}"
    for name in (
        *(
            "antimeridian",
            "charging",
            "composition_file",
            "drone",
            "energy",
            "errors",
            "files",
            "fleet",
            "geodesy",
            "load",
        ),
        *(
            "network",
            "network_builders",
            "network_files",
            "services",
            "telemetry",
            "units",
            "wind_history",
            "wind_summary",
        ),
        "zones",
    )
)
"""Files whose tests call no compiled kernel (``SKYWAY_KERNELS=FOLDER pytest FILES`` lists none): nothing to check the bounds of."""
SHARED = Path(__file__).resolve().parents[2] / "shared"


def pytest_collection_modifyitems(config, items):
    """Leave out, where bounds are checked (``make bounds``), what calls no kernel."""
    if os.environ.get("NUMBA_BOUNDSCHECK") == "1":
        left_out = [item for item in items if item.path.stem in CALL_NO_KERNEL]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item.path.stem not in CALL_NO_KERNEL]


def pytest_collection_finish():
    """Look for waste not among the tests themselves; as often as usual, so that each test answers for its own."""
    gc.freeze()


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
