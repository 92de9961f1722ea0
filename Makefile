# Two commands for newcomers: `make demo` and `make test`. Both set up everything in .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# PyTorch is needed by tests only, pinned here and in pyproject.toml's group "torch".
# `make test TORCH=` leaves it out; the tests that need it are then skipped.
TORCH ?= --group torch

.PHONY: demo test lint clean

demo: $(VENV)/.installed
	$(BIN)/vioapr demo

test: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n auto

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
	$(BIN)/python -m pip install --quiet --editable ".[pose-graph,mapping,render,video,runtime,viser]" --group test --group lint $(TORCH)
	touch $@ $(VENV)/.installed
