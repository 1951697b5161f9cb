# Everything runs in .venv; both stamps may be made in any order and again.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
DEMO   := demo_out
SYSID  := $(BIN)/sysid

.PHONY: demo test test-slow gate bench reports study study-diagnose study-physics study-real docs datasets clean help

help:  ## List what make can do
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/'

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "sysid needs Python 3.11 or newer; name one with: make PYTHON=python3.11 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/.installed-test: pyproject.toml constraints.txt $(VENV)/.installed
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test]'
	@touch $@

demo: $(VENV)/.installed  ## The main job on bundled data: fit, compare, export, simulate, diagnose
	@rm -rf $(DEMO)
	$(SYSID) demo $(DEMO) --run

# Many tests start commands, which would else compile every module again.
unexport PYTHONDONTWRITEBYTECODE

# NPROC: JAX's threads, which spin while they wait
PYTEST := OPENBLAS_NUM_THREADS=1 NPROC=1 $(BIN)/pytest -n 2 --dist worksteal

# mypy runs beside the tests: alone, it would leave a core idle for a minute.
test: $(VENV)/.installed-test  ## Lint, types, layers and all tests but the slow ones
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/mypy --strict sysid cli & types=$$!; $(PYTEST) -m "not slow"; tests=$$?; wait $$types && exit $$tests

test-slow: $(VENV)/.installed-test  ## Tests of whole diagnoses and long fits; .ci/run runs them, too
	$(PYTEST) -m slow

GATE ?=
gate: $(VENV)/.installed  ## Guard of what was reached: errors and times against benchmarks/gate.json, two minutes
	OPENBLAS_NUM_THREADS=1 NPROC=1 $(BIN)/python benchmarks/gate.py $(GATE)

BENCH := .venv-bench
$(BENCH)/.installed: pyproject.toml constraints.txt constraints-bench.txt
	$(PYTHON) -m venv $(BENCH)
	$(BENCH)/bin/pip install --quiet --disable-pip-version-check -c constraints-bench.txt -e '.[bench]'
	@touch $@

bench: $(BENCH)/.installed  ## Time and memory against the plainest reference and against peers
	OPENBLAS_NUM_THREADS=1 $(BENCH)/bin/python benchmarks/bench_linear.py
	$(BENCH)/bin/python benchmarks/bench_nonlinear.py
	$(BENCH)/bin/python benchmarks/bench_diagnose.py
	$(BENCH)/bin/python benchmarks/bench_missions.py

STUDY := OPENBLAS_NUM_THREADS=1 NPROC=1 $(BIN)/python -m studies
KEPT := .study-cache

STUDIES := coverage coverage_of_bands look optimal_input continuous_models closed_loop residual_tests nonlinear_tests nonlinearity robust block_oriented grey_box narx_wavelet \
  fuzz odd_logs tours vehicle dynamic_fit multibody_diagnosis navigation control prediction_intervals multibody
study: $(VENV)/.installed-test  ## Slow studies: coverage, alarm rates, every structure on every record
	set -e; for name in $(STUDIES); do $(STUDY).$$name; done
	$(STUDY).nonlinear --results $(KEPT)/nonlinear.jsonl

study-diagnose: $(VENV)/.installed-test  ## Slow study: what sysid diagnose names on hidden effects, blind
	$(STUDY).diagnose

study-physics: $(VENV)/.installed-test  ## Hours: what it names on machines simulated from physics; goes on where it was stopped
	$(STUDY).physics_diagnose --results $(KEPT)/physics.jsonl

study-real: $(VENV)/.installed-test  ## Study: what sysid diagnose names on measured records
	$(STUDY).real_diagnose

reports: $(VENV)/.installed  ## The tour's pictures and tables again; only the date in their foot changes
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m studies.make_reports

PAGES := build/pages
LINKED := 'benchmarks/gate*' sysid/robot/mission/control/neural.json sysid/robot/mission/control/linear.py sysid/effects/supply.py \
  sysid/structures/grey_box/tanks.py
docs: $(VENV)/.installed  ## The documentation as a site with search: build/site/index.html
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	rm -rf $(PAGES) && mkdir -p $(PAGES)
	git ls-files '*.md' '*.svg' '*.png' LICENSE examples $(LINKED) | xargs cp --parents -t $(PAGES)
	$(BIN)/mkdocs build --quiet --strict -f docs/mkdocs.yml

datasets: $(VENV)/.installed  ## The bundled logs and missions again, byte-identical
	$(BIN)/python datasets/generate.py

clean:  ## Remove what make has made
	rm -rf $(VENV) $(BENCH) $(DEMO) build *.egg-info
