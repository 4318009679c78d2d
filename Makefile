# Everything a newcomer needs: `make quickstart` flies, `make test` checks. Both build what they need in .venv.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

.PHONY: help quickstart test test-slow test-train train-tests lint leaderboard figures clean

help: ## Show this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 14

quickstart: $(VENV)/base ## Fly to a goal (files in flights/), build the demonstration set pid-v0, draw its data card (cards/), evaluate (evaluations/)
	$(BIN)/vvc-bench fly --goal 220,20,-60 --output flights
	$(BIN)/vvc-bench datasets build pid-v0
	$(BIN)/vvc-bench datasets plot pid-v0
	$(BIN)/vvc-bench evaluate --policy pid random --protocol normal-1k-v0 --output evaluations
	$(BIN)/vvc-bench report evaluations/pid evaluations/random --output evaluations/report.html

test: $(VENV)/dev ## Run the tests (a few minutes)
	$(BIN)/python -m pytest -n auto --dist loadfile -m "not slow"

test-slow: $(VENV)/dev ## Run the slow tests
	$(BIN)/python -m pytest -n auto --dist loadfile -m slow

test-train: ## Run the tests that take Stable-Baselines3, imitation and Ray, with the Gymnasium these need (6 GB in .venv-train)
	$(MAKE) VENV=.venv-train train-tests

train-tests: $(VENV)/train
	$(BIN)/python -m pytest -m "not slow" tests/test_stable_baselines.py tests/test_environments.py \
		tests/test_dataset_conversions.py tests/test_policy_conversion.py tests/test_learning.py tests/test_reproduction.py
	$(BIN)/python -m pytest tests/test_documentation.py tests/test_build.py -k "train or ray"

lint: $(VENV)/dev ## Check style, types, import layers and the tables made from definitions
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python docs/figures/fields_table.py --check
	$(BIN)/python docs/figures/environment_pages.py --check

leaderboard: $(VENV)/dev ## Fly every entry of the leaderboard again, and check that its tables are current
	$(BIN)/vvc-bench leaderboard verify --all
	$(BIN)/vvc-bench leaderboard render --check

figures: $(VENV)/dev ## Make the figures and tables of docs/ anew
	set -e; for script in docs/figures/*.py; do echo "== $$script"; $(BIN)/python $$script; done

clean: ## Remove the virtual environments, and what quickstart wrote
	rm -rf $(VENV) .venv-train flights cards evaluations

$(VENV)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "vvc-bench needs Python 3.11 or newer; $(PYTHON) is not: make PYTHON=/path/to/python3.11 ..." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/base: $(VENV)/python pyproject.toml constraints.txt
	$(INSTALL) --editable '.[plot,evaluate]'
	@touch $@

# flycraft has binaries for x86-64 Linux and Windows only; elsewhere the live comparison says that it is skipped.
$(VENV)/dev: $(VENV)/python pyproject.toml constraints.txt
	$(INSTALL) --editable '.[dev]'
	-$(INSTALL) --editable '.[reference]'
	@touch $@

$(VENV)/train: $(VENV)/python pyproject.toml constraints-train.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints-train.txt \
		--editable '.[train,plot,ray]' pytest
	@touch $@
