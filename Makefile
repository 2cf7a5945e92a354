# Needs make and Python 3.11 or newer; every target makes .venv first where it is missing.

VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/ready
DOCS_READY := $(VENV)/docs-ready

# The first Python that is new enough and can make virtual environments; or give PYTHON=...
PYTHON ?= $(shell for python in python3.11 python3 python3.12 python3.13; do \
	$$python -c 'import sys, ensurepip, venv; sys.exit(sys.version_info < (3, 11))' \
	2>/dev/null && echo $$python && break; done)

# Threads that wait for each other by spinning are five times slower on a machine in use.
export OMP_WAIT_POLICY ?= PASSIVE

# Two processes of one thread each; a test file's own fixtures are made once by each of them.
TWO := -m pytest --numprocesses 2 --dist worksteal
PYTEST := OMP_NUM_THREADS=1 $(BIN)/python $(TWO)
QUICK := -m "not slow and not gpu and not thorough"

.PHONY: install demo docs evidence test test-quick test-lowest check test-all bench dist

install: $(READY)

$(READY): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "no Python 3.11 or newer with venv found; give PYTHON=..." >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade "pip>=25.1"
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --group dev --editable .
	@touch $(READY)

# Tunes ball_in_cup from the video of a simulated world whose parameters it cannot look into.
demo: $(READY)
	$(BIN)/simtune tune ball_in_cup --real pseudo --real-episodes 10 --budget-minutes 3.5 --out runs/demo
	@echo "the report: runs/demo/report.html"

# The grid behind the paper's claim. It takes days of one core and hours of many; whatever stops it,
# the same command goes on. `make evidence SWEEP="--workers 2"`, or SWEEP="--ray auto".
EVIDENCE := runs/evidence
evidence: $(READY)
	@echo "docs/sweeps.md says what this costs; to measure it here first:"
	@echo "  $(BIN)/simtune sweep grids/evidence.toml --out $(EVIDENCE) --dry-run"
	@echo "Stop it when you like: the same command goes on. The figures of what is done so far:"
	@echo "  $(BIN)/simtune figures $(EVIDENCE)"
	$(BIN)/simtune sweep grids/evidence.toml --out $(EVIDENCE) $(SWEEP); status=$$?; \
	$(BIN)/simtune figures $(EVIDENCE); exit $$status

# Without those of about a second and more; `make test` before a change is handed on.
test-quick: $(READY)
	$(PYTEST) $(QUICK)

test: $(READY)
	$(PYTEST) -m "not slow and not gpu"

# The quick tests with the lowest versions that pyproject.toml allows. Some gigabytes, since CUDA comes
# with older torch.
LOWEST := .venv-lowest
test-lowest: $(READY)
	$(BIN)/python -m pip install --quiet --group lowest
	$(PYTHON) -m venv --clear --without-pip $(LOWEST)
	$(BIN)/uv pip compile --quiet --resolution lowest-direct --python $(LOWEST)/bin/python \
		--all-extras --group dev --output-file $(LOWEST)/lowest.txt pyproject.toml
	$(BIN)/uv pip install --quiet --python $(LOWEST)/bin/python --requirement $(LOWEST)/lowest.txt
	$(BIN)/uv pip install --quiet --python $(LOWEST)/bin/python --no-deps --editable .
	OMP_NUM_THREADS=1 $(LOWEST)/bin/python $(TWO) $(QUICK)

check: $(READY)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright

# The site, into build/site; a warning is an error.
docs: $(DOCS_READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet
	@echo "build/site/index.html"

$(DOCS_READY): $(READY)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --group docs
	@touch $(DOCS_READY)

# Also the slow tests, and those of a GPU where there is one.
test-all: $(DOCS_READY)
	$(PYTEST) -m ""

# A wheel and an sdist, for an index or a colleague.
dist: $(READY)
	$(BIN)/python -m build --outdir dist

# The last line of each benchmark is one JSON object.
bench: $(READY)
	@for script in $(filter-out benchmarks/common.py, $(wildcard benchmarks/*.py)); do \
		echo "== $$script"; $(BIN)/python $$script --quick || exit 1; \
	done
