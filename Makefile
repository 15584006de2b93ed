# Every target works alone on a fresh clone: it creates .venv and installs first.
PYTHON ?= python3
BIN := .venv/bin
SEEDS ?=
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: install compare gridworld thesis report test lint types check docs clean

install: .venv/installed

.venv/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[dev]'
	touch $@

compare: install  ## the smoke study: every method on one gridworld of photographs, about 5 minutes
	$(BIN)/python -m runs.compare --study smoke --out out/smoke

gridworld: install  ## the study whose scores are committed under runs/results
	$(BIN)/python -m runs.compare --study gridworld --out out/gridworld

thesis: install  ## figures and tables of the thesis, from the committed scores where they are
	$(BIN)/python -m runs.thesis all

report: install
	$(BIN)/python -m runs.report out/smoke

test: install
	$(BIN)/python -m pytest

lint: install
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: install
	$(BIN)/mypy

check: lint types test  ## the developers' gate

docs: install
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[docs]'
	$(BIN)/mkdocs build --strict

clean:
	rm -rf .venv out site
