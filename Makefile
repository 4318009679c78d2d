# Everything a newcomer needs: `make quickstart` flies, `make test` checks. Both build what they need in .venv.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

.PHONY: help quickstart test test-slow lint figures clean

help: ## Show this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 14

quickstart: $(VENV)/base ## Fly to a goal and write the flight as CSV, Parquet, PNG and Tacview files into flights/
	$(BIN)/vvc-bench fly --goal 220,20,-60 --output flights

test: $(VENV)/dev ## Run the tests (a few minutes)
	$(BIN)/python -m pytest -m "not slow"

test-slow: $(VENV)/dev ## Run the slow tests too
	$(BIN)/python -m pytest

lint: $(VENV)/dev ## Check style, types, import layers and the tables of fields
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python docs/figures/fields_table.py --check

figures: $(VENV)/dev ## Make the figures and tables of docs/ anew
	set -e; for script in docs/figures/*.py; do echo "== $$script"; $(BIN)/python $$script; done

clean: ## Remove the virtual environment and what was flown
	rm -rf $(VENV) flights

$(VENV)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "vvc-bench needs Python 3.11 or newer; $(PYTHON) is not: make PYTHON=/path/to/python3.11 ..." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/base: $(VENV)/python pyproject.toml constraints.txt
	$(INSTALL) --editable '.[plot]'
	@touch $@

# flycraft has binaries for x86-64 Linux and Windows only; elsewhere the live comparison says that it is skipped.
$(VENV)/dev: $(VENV)/python pyproject.toml constraints.txt
	$(INSTALL) --editable '.[dev]'
	-$(INSTALL) --editable '.[reference]'
	@touch $@
