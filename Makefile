# On a fresh machine with Python >= 3.11: `make demo` sets up and runs the main job, `make test` sets up and tests.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
# Most of the tests' time goes into compiling programs that run for milliseconds, and with fewer optimizations that
# takes a third as long. Tests of rounding are compiled as users do; `make test XLA_FLAGS=` does so with all. The same
# holds of the few cases of `make quick` and the tutorials that `make docs` runs.
XLA_FLAGS ?= $(shell $(BIN)/python tests/xla_flags.py)

.PHONY: help demo quick test test-matrix lint docs bench ray release-check clean

help:
	@echo "make demo   set up, generate certified scenes, draw them into demo/"
	@echo "make quick  set up, reproduce every table and figure with few cases into reproduction-quick/"
	@echo "make test   set up, run the tests"
	@echo "make lint   set up, check style, types and spelling"
	@echo "make docs   set up, run the tutorials, build the documentation into site/"
	@echo "make bench  set up with the peers, time everything into benchmarks/results.json; ARGS=--quick for a look"
	@echo "make ray    set up with Ray, generate 100,000 scenes while workers, a node and the driver are killed; ARGS='--count 2000' for a look"
	@echo "make test-matrix    run the tests under every Python from 3.11 to 3.14 that is there, or that uv can get"
	@echo "make release-check  build the package, install the wheel into a fresh environment, run demo and tests from it"

# pip would compile all modules of all packages, most of which nothing imports (--no-compile; uv does not either).
$(VENV)/.base: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "deggflow needs Python >= 3.11; set PYTHON=/path/to/python"; exit 1; }
	@if command -v uv >/dev/null 2>&1; then \
		{ test -x $(BIN)/python || uv venv --quiet --python $(PYTHON) $(VENV); } && uv pip install --quiet --python $(BIN)/python -e .; \
	else \
		{ test -x $(BIN)/python || $(PYTHON) -m venv $(VENV); } && $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -e .; \
	fi
	@touch $@

$(VENV)/.dev $(VENV)/.bench $(VENV)/.docs $(VENV)/.ray $(VENV)/.release: $(VENV)/.%: $(VENV)/.base
	@if command -v uv >/dev/null 2>&1; then \
		uv pip install --quiet --python $(BIN)/python -e '.[$*]'; \
	else \
		$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -e '.[$*]'; \
	fi
	@touch $@

demo: $(VENV)/.base
	@$(BIN)/deggflow demo

quick: $(VENV)/.base
	@XLA_FLAGS="$(XLA_FLAGS)" $(BIN)/deggflow reproduce --quick --out reproduction-quick

test: $(VENV)/.dev
	@XLA_FLAGS="$(XLA_FLAGS)" $(BIN)/python -m pytest -n 2 --dist worksteal -m "not rounding"
	@XLA_FLAGS= $(BIN)/python -m pytest -n 2 --dist worksteal -m rounding $$(grep -rl "mark\.rounding" tests --include="test_*.py")

lint: $(VENV)/.dev
	@$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy
	@$(BIN)/mypy --config-file benchmarks/mypy.ini
	@$(BIN)/codespell src tests docs examples benchmarks *.md

docs: $(VENV)/.dev $(VENV)/.docs
	@XLA_FLAGS="$(XLA_FLAGS)" $(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet --builder html docs site
	@echo "The documentation is in site/index.html."

test-matrix:
	@VERSIONS="$(VERSIONS)" EXTRA="$(EXTRA)" tests/matrix.sh $(ARGS)

release-check: $(VENV)/.release
	@PYTHON=$(PYTHON) RELEASE=$(BIN)/python tests/release_check.sh

bench: $(VENV)/.bench
	@$(BIN)/python benchmarks/run.py $(ARGS)

ray: $(VENV)/.ray
	@$(BIN)/python benchmarks/ray_faults.py --folder ray-faults $(ARGS)

clean:
	rm -rf $(VENV) .venvs dist site docs/tutorials demo reproduction-quick ray-faults .pytest_cache .mypy_cache .ruff_cache .hypothesis
