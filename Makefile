# Two commands do all the set-up: `make run` and `make test`. `make help` lists the rest.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
ROBOTS := $(sort $(wildcard derive/robots/*.toml))

.DEFAULT_GOAL := help
.PHONY: help run test fuzz mutants generate check-generated lint types bench embedded notebooks clean

help:  ## Show this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 18

run: $(VENV)/run.installed check-generated  ## Derive the robots, check the generated code, run the paper's studies into results/
	$(BIN)/wmr-afl reproduce --out results

test: lint types  ## Install what is needed and run every check
	$(BIN)/python -m pytest -n 2 -q

fuzz: $(VENV)/test.installed  ## Feed junk to commands and functions, seed after seed, until one ends in a traceback
	$(BIN)/python tests/fuzz.py

mutants: $(VENV)/test.installed  ## Put small faults into the code, one at a time, and count those that tests notice
	$(BIN)/python -m tests.mutation --count 32 --seconds 20

generate: $(VENV)/run.installed  ## Derive every robot again into generated/
	$(BIN)/python -m derive $(ROBOTS) --out generated

check-generated: $(VENV)/run.installed  ## Fail where generated/ is not what the derivation gives
	$(BIN)/python -m derive $(ROBOTS) --out generated --check

lint: $(VENV)/test.installed  ## Check style and the walls between the packages
	$(BIN)/ruff check .
	$(BIN)/ruff format --check --exclude generated .
	$(BIN)/lint-imports --no-cache

types: $(VENV)/test.installed  ## Check types
	$(BIN)/mypy

bench: $(VENV)/bench.installed  ## Measure speed, as ratios within one run, beside other tools
	$(BIN)/python -m benchmarks

embedded: $(VENV)/run.installed  ## Build exported controllers for a Cortex-M, run them in QEMU, count what a step costs
	$(BIN)/python -m benchmarks.embedded

notebooks: $(VENV)/test.installed  ## Execute the notebooks and store their output
	$(BIN)/python -m nbconvert --to notebook --execute --inplace \
		--ExecutePreprocessor.record_timing=False notebooks/*.ipynb

clean:  ## Remove the virtual environment, results and caches
	rm -rf $(VENV) results .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or later is needed")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/run.installed: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[derive]"
	@touch $@

$(VENV)/bench.installed: pyproject.toml $(VENV)/test.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[derive,bench,test]"
	@touch $@

$(VENV)/test.installed: pyproject.toml $(VENV)/run.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[derive,notebooks,test]"
	@touch $@
