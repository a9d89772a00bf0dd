# make demo    the main job on bundled real data, into out/demo
# make test    the tests (make test-slow: those that take longer)
# make test-oldest   some of the tests with the oldest versions that pyproject.toml allows (tests/oldest.txt), on Python 3.10
# make lint    style, formatting, and who imports whom
# make types   the types
# make docs    the documentation site, into out/docs; a warning is an error (make docs-links: do all links lead
#              somewhere; hosts that do not answer are listed)
# make dist    sdist and wheel, into dist/ (make dist-check: the wheel works in an environment of its own)
# make venv    .venv with everything, a usable LLVM included; choose the Python with  make venv PYTHON=python3.12
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.PHONY: venv demo test test-slow test-oldest lint types docs docs-links dist dist-check

PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/installed

venv: $(STAMP)

# The stamp is written last: an interrupted installation is repeated.
$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { \
	    echo "mi_enhance needs Python 3.10 or newer, and $(PYTHON) is not. Run: make venv PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	    echo "$(PYTHON) cannot create virtual environments. Run: apt install python3-venv" >&2; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@echo "Installing mi_enhance and what it needs into .venv; this takes a minute or two."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	@touch $@

demo: venv
	$(BIN)/mi-enhance demo -o out/demo

# Two processes, each a file at a time, with about 2.5 GB each; more with  make test WORKERS=4
WORKERS ?= 2

test: venv
	$(BIN)/python -m pytest -n $(WORKERS)

test-slow: venv
	$(BIN)/python -m pytest -m slow

# An environment of its own. What the package does with its dependencies is in these rooms; the mathematics is the same.
OLDEST := out/oldest
OLDEST_PYTHON ?= python3.10
OLDEST_TESTS ?= tests/test_package.py tests/data tests/material/test_material_maps.py tests/evaluation tests/cli tests/bsdfs/test_plugin_values.py tests/fitting/test_fit.py
test-oldest:
	test -x $(OLDEST)/bin/python || $(OLDEST_PYTHON) -m venv $(OLDEST)
	$(OLDEST)/bin/python -m pip install --quiet --disable-pip-version-check -c tests/oldest.txt pytest pytest-xdist hypothesis -e .
	$(OLDEST)/bin/python -m pytest -q -p no:cacheprovider -W default $(OLDEST_TESTS)

lint: venv
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-logo

types: venv
	$(BIN)/mypy

docs: venv
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs out/docs

docs-links: venv
	$(BIN)/python docs/check_links.py out/docs-links

dist: venv
	rm -rf dist
	$(BIN)/python -m build --outdir dist

# A new environment with the wheel alone in it. What the package needs is not installed again: a path leads to .venv, in which
# the checkout is known by a hook that this path does not run. Used from another folder, with nothing of the checkout in reach.
CHECK := $(CURDIR)/out/dist-check
dist-check: dist
	rm -rf $(CHECK)
	$(BIN)/python -m venv --without-pip $(CHECK)
	$(BIN)/python -m pip --python $(CHECK)/bin/python install --quiet --disable-pip-version-check --no-deps dist/*.whl
	$(BIN)/python -c 'import sys; print(*(p for p in sys.path if p.endswith("-packages")), sep="\n")' \
	    > "$$($(CHECK)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/shared.pth"
	cp tests/installed.py $(CHECK)/
	cd $(CHECK) && bin/python -I installed.py && bin/mi-enhance --version
