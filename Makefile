# make setup | demo | demo-fleet | test | check | explore | bench | docs
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.PHONY: setup demo demo-fleet test slow explore check bounds fuzz kernels bench docs clean

setup: $(STAMP)

$(STAMP): pyproject.toml
	$(PYTHON) -c "import sys; sys.exit('skyway needs Python 3.11 or newer: make setup PYTHON=python3.11') if sys.version_info < (3, 11) else None"
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable ".[dev]"
	@echo "compiling the modules and the kernels, once: two to five minutes"
	@$(BIN)/python -m compileall -q link missions models planner sim_stub skyway
	@$(BIN)/python build_kernels.py models/jit > $(VENV)/kernels.log 2>&1 \
		|| echo "no library of kernels (no C compiler? see $(VENV)/kernels.log): each is compiled when it is first called"
	@touch $(STAMP)

demo: setup
	$(BIN)/skyway demo --output out/demo
	@echo "Plan, fly and replay in a browser: $(BIN)/skyway serve --folder out/demo"
	@echo "Watch a delivery being flown there: $(BIN)/skyway serve --demo --folder out/demo"

# An hour of orders for 50 drones in a simulated New York, on the page; Ctrl-C ends both.
demo-fleet: setup
	$(BIN)/skyway dispatch demo --output out/demo-fleet

# Tests are kept compiled from run to run, also where an image forbids it: compiling them takes 10 s.
test: export PYTHONDONTWRITEBYTECODE :=
test: setup
	$(BIN)/python -m pytest -q -n auto --dist worksteal

slow: setup
	$(BIN)/python -m pytest -q -n auto --dist worksteal -m slow

# Properties with examples that nobody has drawn before, three times as many as by default.
explore: setup
	$(BIN)/python -m pytest -q -n auto --dist worksteal -m "hypothesis and not slow" --hypothesis-profile=explore

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

# Whatever reaches a kernel once more, with every index checked: the tests. Kernels that check are kept apart (models/jit/cache.py).
bounds: setup
	NUMBA_BOUNDSCHECK=1 $(BIN)/python -m pytest -q -n auto --dist worksteal tests/planner tests/models tests/link/logs

FUZZ_S ?= 150
# Random requests with every index checked, for so long and no longer; fails where none was answered.
fuzz: setup
	NUMBA_BOUNDSCHECK=1 $(BIN)/python -m benchmarks.fuzz --strict --seconds $(FUZZ_S)

# Which kernels a wheel holds, and for which types of arguments: what the tests call.
kernels: setup
	rm -rf out/kernels
	SKYWAY_KERNELS=out/kernels $(BIN)/python -m pytest -q -n auto -m "slow or not slow" tests/planner tests/models tests/link tests/cli
	$(BIN)/python build_kernels.py list out/kernels

bench: setup
	$(BIN)/python -m benchmarks

docs: setup
	$(BIN)/python -m tests.rooms_page
	$(BIN)/python -m tests.decisions_page
	$(BIN)/zensical build --strict --clean

clean:
	rm -rf $(VENV) build dist site out
