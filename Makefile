# Two commands: `make demo` runs the main job, `make test` runs every gate. Both install what they need, once.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test lint types imports docs pytest fast browser clean

$(VENV)/.installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt torch
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[synthesis,photos,view,alembic,batch,docs,dev]'
	touch $@

demo: $(VENV)/.installed
	$(BIN)/python -m neural_strands demo demo_out

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.installed
	$(BIN)/pyright

imports: $(VENV)/.installed
	$(BIN)/lint-imports

# The documentation as a site in `site/`; a link that leads nowhere is an error.
docs: $(VENV)/.installed
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

# Modules stay compiled even if the environment forbids it: every program that a test starts would compile them anew.
pytest: $(VENV)/.installed
	PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n logical --dist worksteal

# The page in a browser alone; without Chromium this fails, whereas `make test` skips it.
browser: $(VENV)/.installed
	NEURAL_STRANDS_BROWSER=required $(BIN)/python -m pytest tests/viewer/test_page_in_browser.py

# The tests without those marked slow, for the edit-and-run loop.
fast: $(VENV)/.installed
	PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n logical --dist worksteal -m 'not slow'

test: lint types imports docs pytest

clean:
	rm -rf demo_out site .pytest_cache .ruff_cache
