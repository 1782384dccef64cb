# `make test` and `make demo` need Python 3.11 or later, pip and make; everything else they fetch into .venv.

VENV ?= .venv
ifeq ($(OS),Windows_NT)
BIN := $(VENV)/Scripts
else
BIN := $(VENV)/bin
endif
WORKERS ?= 2
MINUTES ?= 60
SCRIPT := src/gpszip/view/assets/script
NODE := build/node
BENCHMARKS ?= startup reading estep coreset effort merging workers panning

# The first Python on the PATH that is new enough. PYTHON=... names another one.
CANDIDATES := python3 python3.11 python3.12 python3.13 python3.14 python
PYTHON ?= $(shell for p in $(CANDIDATES); do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)

# Bytecode is stored whatever the shell says: without it, each worker collects the tests in 20 s of CPU instead of 8 s,
# and processes that tests start compile the sources anew.
export PYTHONDONTWRITEBYTECODE :=

.DEFAULT_GOAL := help
.PHONY: help test lint types imports page warm pytest interop fuzz faults bench docs wheel man format demo demo-live clean

help:
	@echo "make test     check everything: ruff, mypy, import-linter, pytest; the 20 slowest tests are listed"
	@echo "make page     check the script of the page with tsc, eslint and prettier, which needs node"
	@echo "make interop  test frames and maps with polars, duckdb and all other packages that take them"
	@echo "make fuzz     try all examples of random tests, and feed every reader and the container changed files for MINUTES=60"
	@echo "make faults   let every system call of every command fail, kill each 200 times, compile for any processor (an hour)"
	@echo "make bench    run the experiments of the thesis and the benchmarks (half an hour)"
	@echo "make docs     draw the pictures of the documentation, and build its site in build/site"
	@echo "make wheel    build in dist/ the source archive, and a wheel with compiled kernels for this platform and Python"
	@echo "make man      write the man pages in build/man"
	@echo "make demo     compress a generated robot patrol and draw the map that it learned over its points: demo/map.png"
	@echo "make demo-live  show a generated fleet live: its map, a listener, its page in a browser; Ctrl-C ends it"
	@echo "make format   lay out the code and mend what ruff can mend"
	@echo "make clean    remove the environment, the demo and all caches"

# Kernels are compiled first, else each worker compiles all of them for itself. Checks of the text go side by side with
# that, and those of types with the tests, some of which wait for servers and browsers. The longest job begins first.
test: $(VENV)/.dev
	@$(MAKE) --no-print-directory --jobs=2 --output-sync warm lint imports page
	@$(MAKE) --no-print-directory --jobs=2 pytest types

warm: $(VENV)/.dev
	$(BIN)/gpszip warm

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.dev
	$(BIN)/mypy

imports: $(VENV)/.dev
	$(BIN)/lint-imports

# The script of the page: types, rules and layout. Needs npm, which fetches the tools.
page:
	@if npm install --silent --no-save --prefix $(NODE) typescript@5.9.3 eslint@9.39.5 prettier@3.10.1 >/dev/null 2>&1; then \
		$(NODE)/node_modules/.bin/tsc --project . && \
		$(NODE)/node_modules/.bin/eslint $(SCRIPT) && \
		$(NODE)/node_modules/.bin/prettier --print-width 100 --check $(SCRIPT) $(SCRIPT)/../*.css; \
	else echo "no npm, or no network: the script of the page is not checked" >&2; fi

pytest: $(VENV)/.dev
	$(BIN)/pytest -n $(WORKERS) --dist worksteal --durations=20 -rs

# Frames and maps with all packages that take them; make test skips those that it doesn't install.
interop: $(VENV)/.dev $(VENV)/.interop
	$(BIN)/pytest -rs tests/io/frames tests/io/maps tests/test_pages.py tests/test_python_page.py

fuzz: $(VENV)/.dev
	GPSZIP_EXAMPLES=all $(BIN)/pytest -n $(WORKERS) -m hypothesis
	PYTHONPATH=tests $(BIN)/python -m fuzz.run --minutes $(MINUTES)

faults: $(VENV)/.dev
	GPSZIP_FAULTS=all $(BIN)/pytest tests/faults

bench: $(VENV)/.dev
	$(BIN)/gpszip experiment all -o build/experiments --force
	@for name in $(BENCHMARKS); do \
		echo "== benchmarks/$$name.py"; $(BIN)/python benchmarks/$$name.py || exit 1; done

docs: $(VENV)/.docs
	$(BIN)/python scripts/draw_architecture.py docs/architecture.svg
	$(BIN)/python scripts/draw_gallery.py docs/gallery
	$(BIN)/python scripts/collect_docs.py build/docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet
	$(BIN)/python scripts/finish_site.py build/site
	@echo "open build/site/index.html; the search of pages needs a server: python -m http.server --directory build/site"

# hatch_build.py puts build/compiled into the wheel, so that nothing is compiled where that is installed.
wheel: $(VENV)/.dev
	$(BIN)/python -m pip install --quiet --disable-pip-version-check build
	$(BIN)/python scripts/compile_kernels.py build/compiled
	$(BIN)/python scripts/write_man_pages.py build/man
	$(BIN)/python -m build --sdist --outdir dist
	$(BIN)/python -m build --wheel --outdir dist
	rm -rf build
	$(BIN)/python scripts/check_wheel.py dist

man: $(VENV)/.dev
	$(BIN)/python scripts/write_man_pages.py build/man

format: $(VENV)/.dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

demo: $(VENV)/.plot
	$(BIN)/gpszip demo --out demo --force

demo-live: $(VENV)/.live
	$(BIN)/python scripts/demo_live.py

clean:
	rm -rf $(VENV) demo build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache fuzz-failures
	find src tests -name __pycache__ -type d -prune -exec rm -rf {} +

# A stamp for each extra: made anew when the project's dependencies change.
$(VENV)/.%: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable '.[$*]'
	@touch $@

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "GPSZip needs Python 3.11 or later; name one with make PYTHON=/path/to/python3.11" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
