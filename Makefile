# Everything runs in .venv, which is made from requirements.lock and needs nothing but Python.

PYTHON ?= python3
BIN := .venv/bin
# The numerical libraries' own threads only get in each other's way on small arrays.
export OMP_NUM_THREADS := 1

.DEFAULT_GOAL := help
.PHONY: help demo test coverage check soundness mutation bench scenarios example-planner lock clean
