# make benchmark: set up and run the main job. make test: set up and run the tests.
# make test-full: those that make test leaves out.
# make test-fast: those that start nothing and are quick. make coverage: which lines and branches are tested.
# make test-lowest: a small suite on the lowest versions that pyproject.toml allows.
# make test-examples: the examples whose frameworks make test lacks, in an environment of their own.
# make test-examples-older: those whose frameworks need older libraries, in another one.
# make docs: the site of the documentation, with the board, in build/docs.
# make stale: which committed results are stale, and the commands that make them again.
PYTHON ?= python3
STEPS ?= 2000000
RESULTS ?= results/benchmark$(if $(filter 2000000,$(STEPS)),,-$(STEPS))
BIN = .venv/bin
# What installs: uv where it is, else pip. Where no GPU is, TORCH_INDEX=ADDRESS takes PyTorch from an index of CPU builds, and
# so does UV_TORCH_BACKEND=cpu with uv: 1.4 GB in place of 5.
INSTALL ?= $(if $(shell command -v uv),uv pip install --python $(BIN)/python,$(BIN)/python -m pip install --no-compile --disable-pip-version-check)
TORCH_INDEX ?=
LOWEST = tests/envs/test_single.py tests/envs/test_vector.py tests/envs/test_multi_agent.py tests/envs/test_sb3.py \
	tests/envs/test_discrete.py 	tests/players/test_agent.py tests/training/test_export.py

PYTEST = $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

.PHONY: benchmark test test-full test-fast test-lowest test-examples test-examples-older coverage docs stale clean

benchmark: .venv/.train
	$(BIN)/fpg-bench train ppo-fast FPG/AllyVsScripted-v0 --steps $(STEPS) --out $(RESULTS)/ppo-fast --restart
	$(BIN)/fpg-bench evaluate all-scripted ally-rule/rule/seed_0 $(RESULTS)/ppo-fast/agent --suite ally-v2 --out $(RESULTS)/ally-v2

test: .venv/.dev
	$(PYTEST) -m "not full" --durations=20 --durations-min=5

test-full: .venv/.dev
	$(PYTEST) -m full --durations=20 --durations-min=5

test-fast: .venv/.dev
	$(PYTEST) -m "not (full or process or slow)"

coverage: .venv/.dev
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "pytest-cov>=6" "coverage>=7.10"
	$(PYTEST) --cov --cov-report=term:skip-covered

# Search works without a network, and a warning is an error.
docs: .venv/.docs
	$(BIN)/python -m fpg_bench leaderboard build --out build/extra/board --docs ..
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs build/docs
	@echo "open build/docs/index.html"

stale: .venv/.train
	$(BIN)/python scripts/lineage.py

# One environment: what the benchmark needs (extra train), or all that the tests or the site need (dev, docs; both hold train).
.venv/.train .venv/.dev .venv/.docs: .venv/.%: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit("fpg-bench needs Python 3.11 or newer" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv .venv
	@echo "installing what $* needs into .venv: up to 2 GB, minutes"
	@test -z "$(TORCH_INDEX)" || $(INSTALL) --index-url "$(TORCH_INDEX)" --no-deps -c constraints.txt torch \
		|| echo "no PyTorch from TORCH_INDEX ($(TORCH_INDEX)): the usual build is taken, which may bring CUDA"
	$(INSTALL) -c constraints.txt -e ".[$*]"
	touch $@ .venv/.train

# The lowest versions that pyproject.toml allows, and a small suite on them.
test-lowest: .venv-lowest/.ready
	.venv-lowest/bin/python -m pytest $(LOWEST)

.venv-lowest/.ready: pyproject.toml scripts/lowest.py
	$(PYTHON) -m venv .venv-lowest
	.venv-lowest/bin/python -m pip install --quiet --disable-pip-version-check packaging
	.venv-lowest/bin/python scripts/lowest.py > .venv-lowest/lowest.txt
	.venv-lowest/bin/python -m pip install --quiet --disable-pip-version-check -c .venv-lowest/lowest.txt -e ".[train,video]" pytest hypothesis
	touch $@

test-examples: .venv-examples/.ready
	.venv-examples/bin/python -m pytest tests/test_examples.py -k "not (single_file or notebook)"

.venv-examples/.ready: pyproject.toml constraints.txt examples/requirements.txt
	$(PYTHON) -m venv .venv-examples
	.venv-examples/bin/python -m pip install --quiet --disable-pip-version-check \
		-c constraints.txt -r examples/requirements.txt -e ".[tune,leaderboard]" pytest hypothesis
	touch $@

# Those whose frameworks need older libraries than the constraints name.
test-examples-older: .venv-examples-older/.ready
	.venv-examples-older/bin/python -m pytest tests/test_examples.py -k "agilerl or rllib or tianshou"

.venv-examples-older/.ready: pyproject.toml examples/requirements-older.txt
	$(PYTHON) -m venv .venv-examples-older
	.venv-examples-older/bin/python -m pip install --quiet --disable-pip-version-check \
		-r examples/requirements-older.txt -e ".[tune,leaderboard]" pytest hypothesis
	touch $@

clean:
	rm -rf .venv .venv-examples .venv-examples-older .venv-lowest build docs/reference/generated results/benchmark*
