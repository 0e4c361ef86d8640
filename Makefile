# Two commands: `make demo` runs the main job, `make test` runs every gate. Both install what they need, once.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test lint types imports docs pytest fast browser clean

# Python compiles a module when it is first imported; pip would compile all, almost a third of its time.
PIP_INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt

$(VENV)/.installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP_INSTALL) torch
	$(PIP_INSTALL) -e '.[synthesis,photos,view,alembic,batch,docs,dev]'
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
# Threads that wait for others soon sleep, as in our programs: there are as many tests at a time as processors.
# Memory comes in pages of 2 MB where Linux has them: some virtual machines take long to map one of 4 KB.
TESTS_RUN := PYTHONDONTWRITEBYTECODE= GOMP_SPINCOUNT=2000 \
	GLIBC_TUNABLES=glibc.malloc.hugetlb=1 PYTHONMALLOC=malloc $(BIN)/python

pytest: $(VENV)/.installed
	$(TESTS_RUN) -m pytest -n logical --dist worksteal

# The page in a browser alone; without Chromium this fails, whereas `make test` skips it.
browser: $(VENV)/.installed
	NEURAL_STRANDS_BROWSER=required $(BIN)/python -m pytest tests/viewer/test_page_in_browser.py

# The tests without those marked slow, for the edit-and-run loop.
fast: $(VENV)/.installed
	$(TESTS_RUN) -m pytest -n logical --dist worksteal -m 'not slow'

# The quick checks first; then the type checker, which keeps one processor busy, beside the tests.
test: lint imports
	$(MAKE) --no-print-directory --jobs 3 types docs pytest

clean:
	rm -rf demo_out site .pytest_cache .ruff_cache
