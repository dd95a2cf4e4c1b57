PYTHON ?= python3
BIN := .venv/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
STAMP := .venv/.installed

.PHONY: setup demo test test-lowest quick check lint bench pictures docs licences lock clean

PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
RUN_STAMP := .venv/.installed-to-run

setup: $(STAMP)

# what the main job needs, and no more
$(RUN_STAMP): requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "Python 3.11 or newer is needed, this is " + sys.version.split()[0] + ": make PYTHON=python3.12 ...")'
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@echo "Installing packages (1.3 GB) into .venv; some minutes, once."
	$(PIP) --require-hashes -r requirements.lock
	$(PIP) --no-deps --no-build-isolation --editable .
	touch $@

# all extras, and the tools of tests and checks
$(STAMP): $(RUN_STAMP) requirements-dev.lock
	$(PIP) --require-hashes -r requirements-dev.lock
	touch $@

demo: $(RUN_STAMP)
	@echo "Tracking the built-in bat (1 to 3 minutes)."
	$(BIN)/mocap demo bat --out out/demo --force

test: setup
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses auto --maxprocesses 4

# the oldest versions that pyproject.toml admits; what these say of each other's age is not ours to mend
LOWEST := .venv-lowest
LOWEST_PYTHON := $(LOWEST)/$(notdir $(BIN))/python

$(LOWEST)/.installed: requirements-lowest.lock pyproject.toml
	test -x $(LOWEST_PYTHON) || $(PYTHON) -m venv $(LOWEST)
	$(LOWEST_PYTHON) -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-lowest.lock
	$(LOWEST_PYTHON) -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@

# the tests of `make quick` but those of views (rerun has one version) and of the site, which is built with the locked ones
test-lowest: $(LOWEST)/.installed
	OMP_NUM_THREADS=1 $(LOWEST_PYTHON) -m pytest --numprocesses auto --maxprocesses 4 -m "not slow" -W ignore::DeprecationWarning \
	    tests --ignore=tests/mocap/rerun --ignore=tests/test_docs.py

quick: setup
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses auto --maxprocesses 4 -m "not slow"

check: test lint

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

bench: setup
	for name in tracker_speed main_job importers attack; do $(BIN)/python -m benchmarks.$$name || exit 1; done

pictures: setup
	$(BIN)/python -m docs.tools.view_pictures docs/pictures

licences: setup
	$(BIN)/python -m docs.tools.licences

docs: setup
	OMP_NUM_THREADS=1 $(BIN)/python docs/build.py build/docs

LOCK := $(BIN)/uv pip compile --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links

lock: setup
	$(LOCK) --group build pyproject.toml -o requirements.lock
	$(LOCK) --all-extras --group dev --constraint requirements.lock pyproject.toml -o requirements-dev.lock
	$(LOCK) --all-extras --group test --resolution lowest-direct pyproject.toml -o requirements-lowest.lock

clean:
	rm -rf .venv .venv-lowest .venv-movement out build *.egg-info .pytest_cache .ruff_cache
