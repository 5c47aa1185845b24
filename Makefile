# Two commands do everything on a fresh machine: `make demo` and `make test`.
PYTHON ?= python3
BIN := .venv/bin
export OPENBLAS_NUM_THREADS ?= 1
export PYTHONDONTWRITEBYTECODE :=  # each process would compile every module anew

.PHONY: demo test check lint types bench bench-speed blind slow faults fuzz digest docs walks clean

.venv/.ok: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt torch
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	touch $@

demo: .venv/.ok
	$(BIN)/tactilevision calibrate sample_frames/gelslim3 --out demo_out

test: .venv/.ok
	$(BIN)/python -m pytest -n auto --dist worksteal

lint: .venv/.ok
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache

types: .venv/.ok
	$(BIN)/mypy
	$(BIN)/mypy tests examples

check: lint types test

slow: .venv/.ok
	$(BIN)/python -m pytest -m slow

# Every benchmark; `make bench QUICK=1` runs the smallest case of each, in minutes.
bench: .venv/.ok
	$(BIN)/python -m benchmarks $(if $(QUICK),--quick)

# Processor time and memory of commands and frames, as ratios to another revision: `make bench-speed BASE=v1`.
# `make bench-speed WRITE=1` writes README's times.
bench-speed: .venv/.ok
	$(BIN)/python -m benchmarks.speed $(if $(BASE),--base $(BASE)) $(if $(WRITE),--write)

blind: .venv/.ok
	$(BIN)/python -m benchmarks.blind

# Kills, full disks, changing files and more under five commands: `make faults KILLS=200 OTHERS=3 SEED=1`.
faults: .venv/.ok
	$(BIN)/python -m benchmarks.faults --kills $(or $(KILLS),60) --others $(or $(OTHERS),1) --seed $(or $(SEED),0)

# Mutants of input files under their readers: `make fuzz READER=png MINUTES=10` (all readers, a minute each).
fuzz: .venv/.ok
	$(BIN)/python -m benchmarks.fuzz --reader $(or $(READER),all) --minutes $(or $(MINUTES),1)

# What the commands give, compared with tests/digest.json; `make digest WRITE=1` records it anew.
digest: .venv/.ok
	$(BIN)/python -m benchmarks.digest $(if $(WRITE),--write)

docs: .venv/.ok
	$(BIN)/sphinx-build -W --keep-going -q docs docs/_build
	$(BIN)/python docs/check_links.py docs/_build

# Numbers and pictures of the walks, as their commands give them now (docs/fill.py).
walks: .venv/.ok
	$(BIN)/python docs/fill.py

clean:
	rm -rf .venv build dist docs/_build docs/gallery demo_out
