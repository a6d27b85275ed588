# `make` lists the targets of every day, `make all-targets` all of them. Each makes .venv first if need be, so a fresh clone
# needs no other step.

PAPERS := $(wildcard configs/paper*.yaml)
SWEEPS := configs/sweep_crossing.yaml configs/sweep_resistance.yaml
CONFIGS ?= $(PAPERS)
RUNS = $(patsubst %.yaml,runs/%.h5,$(notdir $(CONFIGS)))
# A file that is named by what --set changes; _ stands for its asterisk.
QUADRUPLE := $(PAPERS:configs/%.yaml=build/reference/%,_.precision=quadruple.h5)

# The first Python that is new enough; looked for only when .venv has to be made.
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)

VENV := .venv
BIN := $(VENV)/bin
# Two stamps, so that drawing the figures does not wait for the tools of the tests.
READY := $(VENV)/.ready
TOOLS := $(VENV)/.ready-dev
# Of the lowest versions there are no wheels for a later Python.
LOWEST := build/lowest/.ready
OLDEST = $(shell command -v python3.11 || command -v python3.12 || echo $(BIN)/python)
MEETING := $(addprefix tests/test_,results.py quantities.py cli.py error.py integrate.py classify.py install.py)
# A file's tests stay in one process, so that what its fixtures integrate is integrated once.
PYTEST := $(BIN)/pytest -q -n logical --maxprocesses 4 --dist loadfile --no-loadscope-reorder

UV := $(shell command -v uv 2>/dev/null)
PIP = $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
LOCK := uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --custom-compile-command 'make lock'

# The recipes start hodo dozens of times, the tests hundreds: each would compile all of it anew.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help all-targets setup run classify claims figures sweeps speed compare reference test lowest limits stress lint bench docs lock clean

help:
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)
	@echo "  CONFIGS=mine.yaml limits run, classify and figures to the case files named; make all-targets lists the rest."

all-targets:
	@awk -F ':.*#[#:] ' '/^[a-z-]+:.*#[#:] / { printf "  %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: $(READY)  #: Make .venv with what running needs (by uv if it is installed, else by venv and pip)

run: $(READY)  ## Integrate every case of the papers into runs/ (finished cases are not run again)
	$(BIN)/hodo run $(CONFIGS)

classify: run  ## Label the axis that each hodograph encloses and find the separatrix crossings
	$(BIN)/hodo classify $(RUNS)

claims: classify  ## Check what the papers say against the results (exit status 3: a verdict is not the expected one)
	$(BIN)/hodo claims $(RUNS)

figures: $(READY)  ## The main job: run, classify, check the claims and draw every figure into runs/figures/
	$(BIN)/python tools/figures.py $(CONFIGS)

sweeps: $(READY)  ## Run the ensembles but for the million, and draw their maps (needs heyoka; some 20 seconds)
	$(BIN)/hodo run $(SWEEPS) -j 2
	$(BIN)/hodo classify $(SWEEPS:configs/%.yaml=runs/%.h5)
	$(BIN)/hodo plot $(SWEEPS:configs/%.yaml=runs/%.h5)

speed: $(READY)  #: Time sweeps beside plain loops (some 3 minutes); renews docs/sweeps.md
	($(BIN)/python tools/machine.py; $(BIN)/python tools/sweep_speed.py) \
		| $(BIN)/python tools/tables.py docs/sweeps.md speed

compare: $(READY)  #: Run the papers anew and compare with runs/reference (OPTIONS='--rtol 1e-8' without heyoka)
	$(BIN)/hodo run $(PAPERS) --force --quiet --out build/compare >/dev/null
	$(BIN)/hodo classify $(PAPERS:configs/%.yaml=build/compare/%.h5) >/dev/null
	@status=0; for paper in $(PAPERS:configs/%.yaml=%); do \
		$(BIN)/hodo compare $(OPTIONS) build/compare/$$paper.h5 runs/reference/$$paper.h5 || status=$$?; \
	done; exit $$status

reference: $(READY)  #: Compute runs/reference anew, in quadruple precision
	$(BIN)/hodo run $(PAPERS) --set '*.precision=quadruple' --force --quiet --out build/reference
	$(BIN)/hodo classify $(QUADRUPLE)
	$(BIN)/python tools/reference.py runs/reference $(QUADRUPLE)

test: lint  ## The checks of `lint`, then the whole test suite
	$(PYTEST)

lowest: $(LOWEST)  #: The tests that meet the libraries most, with the lowest versions that pyproject.toml allows
	$(dir $(LOWEST))bin/pytest -q -n logical --maxprocesses 4 --dist loadfile --no-loadscope-reorder -p no:cacheprovider $(MEETING)

limits: $(READY)  #: Try the limits of docs/papers.md at both ends of their ranges: no verdict may change
	$(BIN)/python tools/limits.py build/limits

stress: $(TOOLS)  #: Kill runs, lose the power, let calls fail, let twenty commands meet, feed the loader bad inputs (some 30 minutes)
	$(BIN)/python tests/stress.py
	HODO_FUZZ=5000 $(PYTEST) tests/test_case.py tests/test_figures.py

lint: $(TOOLS)  #: ruff on everything (rules and format), mypy --strict on the package
	$(BIN)/ruff check .
	$(BIN)/ruff format --check --quiet .
	$(BIN)/mypy

bench: $(READY)  #: Error against run time, and the extreme cases (10 minutes); renews docs/accuracy.md
	@mkdir -p runs; status=0; for config in error_time extreme; do \
		$(BIN)/hodo bench configs/$$config.yaml -j 2 --markdown > runs/$$config.md || status=1; \
		($(BIN)/python tools/machine.py; grep -v '| accurate |' runs/$$config.md) \
			| $(BIN)/python tools/tables.py docs/accuracy.md "bench: $$config"; \
	done; \
	cp runs/figures/error_time.bench.svg docs/error_time.svg; \
	exit $$status

docs: claims  #: Renew what the documents quote from the program, and what they say of the papers
	mkdir -p build; $(BIN)/hodo schema --table > build/keys.md
	sed '/^## Keys of figures/,$$d' build/keys.md | $(BIN)/python tools/tables.py docs/case-files.md keys
	sed '/^## Keys of figures/,/^## Keys of statements/!d; /^## Keys of statements/d' build/keys.md \
		| $(BIN)/python tools/tables.py docs/figures.md keys
	sed '/^## Keys of statements/,$$!d' build/keys.md | $(BIN)/python tools/tables.py docs/claims.md keys
	$(BIN)/python tools/models.py | $(BIN)/python tools/tables.py docs/models.md models
	for paper in $(PAPERS:configs/%.yaml=%); do \
		$(BIN)/hodo claims runs/$$paper.h5 --markdown \
			| $(BIN)/python tools/tables.py docs/$$paper.md $$paper; \
	done
	$(BIN)/hodo run configs/satellite.yaml
	$(BIN)/hodo classify runs/satellite.h5
	for picture in satellite=satellite/satellite paper1=paper1/fig12-readings paper2=paper2/x paper3=paper3/u3; do \
		figure=$${picture#*=}; \
		$(BIN)/hodo plot configs/$${figure%/*}.yaml $${figure#*/} --format svg --out build/pictures; \
		cp build/pictures/$$figure.svg docs/$${picture%=*}.svg; \
	done

lock:  #: Renew both lock files from pyproject.toml (needs uv; UPGRADE=--upgrade takes newer versions)
	$(LOCK) $(UPGRADE) --all-extras --output-file requirements-dev.lock pyproject.toml
	$(LOCK) --upgrade --extra build --constraint requirements-dev.lock --output-file requirements.lock pyproject.toml

clean:  #: Remove results, figures and caches; keep .venv and runs/reference
	[ ! -d runs ] || find runs -mindepth 1 -maxdepth 1 ! -name reference -exec rm -rf {} +
	rm -rf build dist .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find hodo_cli tests -name __pycache__ -prune -exec rm -rf {} +

# Modules are compiled when they are first imported: most of what is installed never is.
$(READY): pyproject.toml requirements.lock
ifneq ($(UV),)
	uv venv --quiet --allow-existing --python '$(or $(PYTHON),>=3.11)' $(VENV)
	uv pip sync --quiet --python $(BIN)/python --require-hashes requirements.lock
	uv pip install --quiet --python $(BIN)/python --no-deps --no-build-isolation --editable .
else
	@test -n '$(PYTHON)' || { \
		echo 'hodo needs Python 3.11 or newer: sudo apt-get install -y python3 python3-venv' >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { \
		echo '$(PYTHON) cannot make virtual environments: sudo apt-get install -y $(notdir $(PYTHON))-venv' >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(PIP) --require-hashes --requirement requirements.lock
	$(PIP) --no-deps --no-build-isolation --editable .
endif
	@# Or else the two processes that draw first would each compile the same thousand modules.
	@$(BIN)/python -c 'import hodo_cli.figures'
	@touch $@

$(LOWEST): pyproject.toml tools/lowest.py $(READY)
	rm -rf $(@D)
	$(OLDEST) -m venv $(@D)
	$(BIN)/python tools/lowest.py > $(@D)/floors.txt
	$(@D)/bin/python -m pip install --quiet --disable-pip-version-check --no-compile --requirement $(@D)/floors.txt
	$(@D)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@

$(TOOLS): $(READY) requirements-dev.lock
ifneq ($(UV),)
	uv pip install --quiet --python $(BIN)/python --require-hashes --requirement requirements-dev.lock
else
	$(PIP) --require-hashes --requirement requirements-dev.lock
endif
	@touch $@
