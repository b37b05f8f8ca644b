# make run      all stages on the sample logs (report in reports/sample_logs/)
# make test     everything that is checked: style, types, tests
# make study    the statistical studies, in full; what is done is kept and not done again
# make bench    nanoseconds a step of each model, one fit against CasADi and scipy, and the predictive
#               controllers against their period and their programs in other solvers, and reading a log of
#               1 GB against other readers, as ratios (writes 1 GB at a time to a temporary folder)
# make schema   JSON Schemas of the outputs, from the classes of ident/results.py
# make samples  the sample logs again, from their seed
# make lock     the pinned requirements again, from pyproject.toml (needs uv: https://docs.astral.sh/uv)
# make clean    remove what the others made
#
# Needs Python 3.11, 3.12 or 3.13; PYTHON=/path/to/python chooses one.

VENV := .venv
BIN := $(VENV)/bin

IN_RANGE := import ensurepip, sys, venv; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 14))
CANDIDATES := python3.13 python3.12 python3.11 python3 python
FOUND = $(firstword $(foreach p,$(CANDIDATES),$(shell $(p) -c '$(IN_RANGE)' >/dev/null 2>&1 && echo $(p))))
PYTHON ?= $(FOUND)

# A virtual environment whose interpreter is gone is made anew.
ifneq ($(shell $(BIN)/python -c 'print("runs")' 2>/dev/null),runs)
.PHONY: $(VENV)/run.stamp $(VENV)/dev.stamp
endif

.PHONY: run test study bench schema samples lock clean

run: $(VENV)/run.stamp
	$(BIN)/ident run pipelines/truck.yaml sample_logs/

test: $(VENV)/dev.stamp
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/python -m pytest -n 2 --dist loadgroup

study: $(VENV)/dev.stamp
	$(BIN)/python studies/steering_coverage.py --seeds 200 --jobs 2
	$(BIN)/python studies/steering_efficiency.py --sets 1000 --jobs 2
	$(BIN)/python studies/tyre_bound.py
	$(BIN)/python studies/tyre_inputs.py --whole --jobs 2
	$(BIN)/python studies/tyre_coverage.py --seeds 500 --jobs 2
	$(BIN)/python studies/pac2002_coverage.py --seeds 500
	$(BIN)/python studies/two_track_tandem.py
	$(BIN)/python studies/improve_null.py --sets 100 --jobs 2
	$(BIN)/python studies/improve_power.py --seeds 20 --jobs 2 --hours 2
	$(BIN)/python studies/improve_whole.py --seeds 60 --jobs 2 --hours 2
	$(BIN)/python studies/improve_coverage.py --sets 500 --jobs 2 --hours 2
	$(BIN)/python studies/controller_weights.py
	$(BIN)/python studies/damage_table.py
	$(BIN)/python studies/fuzz_logs.py --count 100000 --hours 2
	IDENT_EVERY_SET=1 $(BIN)/python -m pytest -q tests/stages/test_improve_undeclared.py
	IDENT_KILL_ROUNDS=40 IDENT_KILL_EVERY=1 $(BIN)/python -m pytest -q tests/pipeline/test_kill.py

bench: $(VENV)/dev.stamp
	$(BIN)/python benchmarks/bench_models.py
	$(BIN)/python benchmarks/bench_fit.py
	$(BIN)/python benchmarks/bench_mpc.py
	$(BIN)/python benchmarks/bench_logs.py

schema: $(VENV)/dev.stamp
	$(BIN)/python -m ident.pipeline.schema docs/schema

samples: $(VENV)/dev.stamp
	$(BIN)/python sample_logs/generate.py

# The build system comes from the lock too, so that installing the project itself downloads nothing.
define install
	@$(BIN)/python -c '$(IN_RANGE)' >/dev/null 2>&1 || { \
	  test -n "$(PYTHON)" || { echo "no Python 3.11, 3.12 or 3.13 with venv was found: install one, or say PYTHON=/path/to/python" >&2; exit 1; }; \
	  rm -rf $(VENV) && "$(PYTHON)" -m venv $(VENV); }
	@echo "installing $(1) into $(VENV)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --only-binary :all: -r $(1)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps --editable .
	@touch $@
endef

$(VENV)/run.stamp: requirements.lock pyproject.toml
	$(call install,requirements.lock)

$(VENV)/dev.stamp: requirements-dev.lock pyproject.toml
	$(call install,requirements-dev.lock)

# What is used at run time has the same version in both. UPGRADE=--upgrade takes newer versions.
COMPILE = uv pip compile pyproject.toml --group build --universal --generate-hashes --python-version 3.11 \
	--no-header --no-annotate --no-emit-index-url --no-config --fork-strategy fewest --quiet $(UPGRADE)

lock:
	$(COMPILE) --extra dev --output-file requirements-dev.lock
	$(COMPILE) --constraints requirements-dev.lock --output-file requirements.lock

clean:
	rm -rf $(VENV) reports dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
