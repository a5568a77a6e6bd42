# The first use makes .venv; nothing but Python 3.11 or newer, its pip, and make is assumed.
PYTHON ?= python3
BIN := .venv/bin
RUNTIME := .venv/.installed
TEST := .venv/.installed-test

.PHONY: run test test-pages test-processors test-scheduler check format report leaderboard site trial benchmark clean

run: $(RUNTIME)
	$(BIN)/fdbench run

report: $(RUNTIME)
	$(BIN)/fdbench report results -o results/report.html

leaderboard: $(RUNTIME)
	$(BIN)/fdbench leaderboard results

# The documentation as pages for a browser, in build/site.
site: $(RUNTIME)
	@$(PYTHON) -m pip --python $(BIN)/python install --quiet --editable ".[site]"
	$(BIN)/python docs/make_site.py

# Each effect in its own record, then a trial of the diagnosis beside quick reference rows; what is done is kept.
TIER ?= B
COUNT ?= 10
DIAGNOSERS ?= null random recalibration_only largest_correlation sparse_regression fdbench
trial: OUT := results/trials/$(TIER)
trial: $(RUNTIME)
	@mkdir -p results/trials
	@test -e results/trials/own_records.md || $(BIN)/python benchmarks/own_records.py > results/trials/own_records.md
	@cat results/trials/own_records.md
	@test -e $(OUT) || $(BIN)/fdbench trial make $(OUT) --key $(OUT).key.json --tier $(TIER) --count $(COUNT)
	@for name in $(DIAGNOSERS); do \
	  test -e $(OUT).$$name.json || $(BIN)/fdbench trial answer $(OUT) --diagnoser $$name -o $(OUT).$$name.json || exit; \
	  echo; $(BIN)/fdbench trial score $(OUT) $(OUT).$$name.json --key $(OUT).key.json; \
	done

# Speed beside other packages, which are installed into .venv.
benchmark: $(RUNTIME)
	@$(PYTHON) -m pip --python $(BIN)/python install --quiet --editable ".[peers]"
	@for script in benchmarks/*_speed.py; do echo; $(BIN)/python $$script || exit; done

test: $(TEST)
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder -m "not processors and not pages"

# README.md, tutorials and how-to pages, executed block after block.
test-pages: $(TEST)
	$(BIN)/python -m pytest -n 2 --no-loadscope-reorder -q -m pages tests

# As on other processors: kernels of linear algebra without vectors and with narrower ones, machine code for any.
test-processors: $(TEST)
	@for processor in "OPENBLAS_CORETYPE=Prescott NUMBA_CPU_NAME=generic" "OPENBLAS_CORETYPE=Haswell"; do \
	  echo "as on $$processor"; env $$processor $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder -q -m linear_algebra tests || exit; \
	done
	@echo "as on several, one beside the other"; $(BIN)/python -m pytest -q -m processors tests

# On a scheduler and two workers of Dask, which is installed into .venv: 40 MB that nothing else needs.
test-scheduler: $(TEST)
	$(PYTHON) -m pip --python $(BIN)/python install --quiet --editable ".[test,dask]"
	$(BIN)/python -m pytest -q tests/benchmark/test_scheduler.py

check: $(TEST)
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(MAKE) --no-print-directory test
	$(MAKE) --no-print-directory test-pages
	$(MAKE) --no-print-directory test-processors

format: $(TEST)
	$(BIN)/ruff format
	$(BIN)/ruff check --fix

clean:
	rm -rf .venv build dist .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find fdbench baselines tests -name __pycache__ -prune -exec rm -rf {} +

$(TEST): EXTRAS := [test]
$(RUNTIME) $(TEST): pyproject.toml fdbench/version.py | $(BIN)/python
	@echo "installing fdbench$(EXTRAS) and what it needs into .venv"
	$(PYTHON) -m pip --python $(BIN)/python install --quiet pip --editable ".$(EXTRAS)"
	@touch $@

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "fdbench needs Python 3.11 or newer: make PYTHON=/path/to/it")'
	$(PYTHON) -m venv --without-pip .venv
