# Everything runs in .venv, which is made from requirements.lock and needs nothing but Python.

PYTHON ?= python3
BIN := .venv/bin
# The numerical libraries' own threads only get in each other's way on small arrays.
export OMP_NUM_THREADS := 1

.DEFAULT_GOAL := help
.PHONY: help demo test check soundness mutation scenarios lock clean

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z.]+:.*## /{printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

.venv: .venv/.installed  ## the virtual environment, from requirements.lock

.venv/.installed: pyproject.toml requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
	  { echo "make: $(PYTHON) is not Python 3.11 or newer; name one: make PYTHON=python3.12 ..." >&2; exit 2; }
	$(PYTHON) -m venv .venv
	@# The lock is complete: nothing is resolved, so no later release can get in the way.
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps -e .
	$(BIN)/python -m pip check --disable-pip-version-check
	@touch $@

demo: .venv/.installed  ## decide the intersection scenario with the built-in ranker; pictures in demo/
	$(BIN)/sandra demo

test: .venv/.installed  ## the tests
	$(BIN)/python -m pytest -n 2

check: .venv/.installed  ## format, lint, types, import contract, links of the documents
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python scripts/check_links.py

soundness: .venv/.installed  ## many random trajectories against the reachable sets (minutes)
	$(BIN)/python -m pytest tests/reach -m soundness

.venv-mutation/.installed: requirements.lock scripts/mutation/requirements.txt
	$(PYTHON) -m venv .venv-mutation
	.venv-mutation/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -r requirements.lock
	.venv-mutation/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -r scripts/mutation/requirements.txt
	.venv-mutation/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -e .
	@touch $@

ROOM ?=
SAMPLE ?= 200
WORKERS ?= 1
mutation: .venv-mutation/.installed  ## do the tests see small changes of the safety core? [ROOM=logic SAMPLE=all WORKERS=2]
	.venv-mutation/bin/python scripts/mutation_score.py $(ROOM) --sample $(SAMPLE) --workers $(WORKERS) $(ARGS)

scenarios: .venv/.installed  ## make the project's own scenarios anew
	$(BIN)/python scripts/make_scenarios.py

lock:  ## resolve requirements.lock anew (needs uv)
	uv pip compile --quiet --universal --python-version 3.11 --group dev --generate-hashes \
	  --no-emit-index-url --no-emit-find-links --custom-compile-command "make lock" \
	  --output-file requirements.lock pyproject.toml

clean:  ## remove the virtual environment, caches and pictures
	rm -rf .venv .venv-mutation .mutation demo build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
