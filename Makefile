# Everything runs in .venv, which is made from requirements.lock and needs nothing but Python.

PYTHON ?= python3
BIN := .venv/bin
# The numerical libraries' own threads only get in each other's way on small arrays.
export OMP_NUM_THREADS := 1

.DEFAULT_GOAL := help
.PHONY: help demo test coverage check docs docs-serve soundness closed-loop differential mutation bench scenarios example-planner example-shield lock clean

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z.-]+:.*## /{printf "  make %-15s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

.venv: .venv/.installed  ## the virtual environment, from requirements.lock

.venv/.installed: pyproject.toml requirements.lock requirements-torch.txt setup.py $(wildcard src/sandra/reach/native/*)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
	  { echo "make: $(PYTHON) is not Python 3.11 or newer; name one: make PYTHON=python3.12 ..." >&2; exit 2; }
	$(PYTHON) -m venv .venv
	@# The lock is complete: nothing is resolved, so no later release can get in the way.
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-compile -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-compile --retries 1 -r requirements-torch.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps -e .
	$(BIN)/python -m pip check --disable-pip-version-check
	@touch $@

demo: .venv/.installed  ## decide the intersection scenario with the language model that comes along; pictures in demo/
	$(BIN)/sandra demo

test: .venv/.installed  ## the tests
	$(BIN)/python -m pytest -n 3

coverage: .venv/.installed  ## lines and branches of the safety core that the tests reach (minutes)
	$(BIN)/python -m pytest -n 2 --cov=sandra --cov-branch --cov-report=json:.coverage.json
	$(BIN)/python scripts/check_coverage.py .coverage.json

check: .venv/.installed  ## format, lint, types, import contract, links of the documents
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python scripts/check_links.py

docs: .venv/.installed  ## the documentation site, into site/; a link that leads nowhere is an error
	$(BIN)/python -m sphinx -q -W --keep-going $(ARGS) -c docs . site
	@rm -rf jupyter_execute  # the executed notebooks, beside the site
	@echo "site/index.html"

docs-serve: docs  ## build the site and serve it at http://127.0.0.1:8001
	$(BIN)/python -m http.server --bind 127.0.0.1 --directory site 8001

soundness: .venv/.installed  ## reachable sets against random trajectories, certificates against adversaries
	$(BIN)/python -m pytest tests/reach -m soundness
	$(BIN)/sandra evaluate soundness --rollouts 10000

differential: .venv/.installed  ## verdicts against an exhaustive grid search, into docs/differential.md (minutes)
	$(BIN)/python scripts/differential.py --scenes 500 --seed 1 --workers 1

bench: .venv/.installed .venv-peer/.installed  ## our sets beside a peer's, timed; stages of a decision [ARGS='merge --runs 5']
	$(BIN)/sandra bench reach $(ARGS)
	$(BIN)/sandra bench decide

# The peer needs an older Python and older packages than we do, hence an environment of its own.
PEER_PYTHON ?= python3.11
.venv-peer/.installed: scripts/peer/requirements.txt
	@$(PEER_PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null || \
	  { echo "make: $(PEER_PYTHON) is not Python 3.11, which the peer needs; name one: make bench PEER_PYTHON=/path/to/python3.11, or time ours alone: sandra bench reach --no-peer" >&2; exit 2; }
	$(PEER_PYTHON) -m venv .venv-peer
	.venv-peer/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -r $<
	@touch $@

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

closed-loop: .venv/.installed  ## drivers without a verifier on the paper's seeds (minutes)
	$(BIN)/sandra evaluate closed-loop --paper-seeds --profile paper --convention paper

scenarios: .venv/.installed  ## make the project's own scenarios anew
	$(BIN)/python scripts/make_scenarios.py

example-planner: .venv/.installed .venv-planner/.installed  ## a published planner in our corridor; picture in demo/
	$(BIN)/python examples/reactive_planner/run.py

# That planner needs an older commonroad-io than we do, hence an environment of its own.
.venv-planner/.installed: examples/reactive_planner/requirements.txt
	$(PYTHON) -m venv .venv-planner
	.venv-planner/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -r $<
	@touch $@

example-shield: .venv-shield/.installed  ## a DQN is trained, then drives without and with the shield (half an hour) [SEEDS=20]
	.venv-shield/bin/python examples/shield/train.py
	.venv-shield/bin/python examples/shield/compare.py --seeds $(or $(SEEDS),20)

# PyTorch and Stable-Baselines3 are too heavy for the project's own lock.
.venv-shield/.installed: requirements.lock pyproject.toml setup.py examples/shield/requirements.txt
	$(PYTHON) -m venv .venv-shield
	.venv-shield/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -r requirements.lock
	.venv-shield/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -r examples/shield/requirements.txt
	.venv-shield/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -e .
	@touch $@

lock:  ## resolve requirements.lock anew (needs uv)
	uv pip compile --quiet --universal --python-version 3.11 --extra highway --extra local --extra distributed --extra finetune --extra view --group dev --generate-hashes \
	  --overrides scripts/without-torch.txt \
	  --no-emit-index-url --no-emit-find-links --custom-compile-command "make lock" \
	  --output-file requirements.lock pyproject.toml

clean:  ## remove the virtual environment, caches and pictures
	rm -rf .venv .venv-mutation .venv-peer .venv-planner .venv-shield .mutation demo site build dist src/sandra/reach/_native.* .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
