# make benchmark: set up and run the main job. make test: set up and run the tests.
# make test-fast: those that start nothing and are quick. make coverage: which lines and branches are tested.
PYTHON ?= python3
STEPS ?= 2000000
RESULTS ?= results/benchmark$(if $(filter 2000000,$(STEPS)),,-$(STEPS))
BIN = .venv/bin

PYTEST = $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

.PHONY: benchmark test test-fast coverage clean

benchmark: .venv/.ready
	$(BIN)/fpg-bench train ppo-fast FPG/AllyVsScripted-v0 --steps $(STEPS) --out $(RESULTS)/ppo-fast --restart
	$(BIN)/fpg-bench evaluate all-scripted $(RESULTS)/ppo-fast/agent --field ally-v1 --out $(RESULTS)/ally-v1

test: .venv/.ready
	$(PYTEST) --durations=20 --durations-min=5

test-fast: .venv/.ready
	$(PYTEST) -m "not (browser or llama or postgres or process or ray or slow)"

coverage: .venv/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "pytest-cov>=6" "coverage>=7.10"
	$(PYTEST) --cov --cov-report=term:skip-covered

.venv/.ready: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit("fpg-bench needs Python 3.11 or newer" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[dev]"
	touch $@

clean:
	rm -rf .venv results
