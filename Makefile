# Two commands: `make demo` and `make test`. Both set up everything they need first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
DATA ?=

export DO_NOT_TRACK = 1
export PREFECT_SERVER_ANALYTICS_ENABLED = false
export MLFLOW_DISABLE_TELEMETRY = true

.PHONY: setup demo test test-thorough test-slow bench lint lock docs plant chaos clean

setup: $(READY)

$(READY): pyproject.toml requirements.lock
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip install --python $(BIN)/python --quiet --compile-bytecode --require-hashes --requirement requirements.lock
	$(BIN)/uv pip install --python $(BIN)/python --quiet --no-deps --editable .
	touch $(READY)

demo: $(READY)
	$(BIN)/python -m flows.demo $(if $(DATA),--data $(DATA),)

test: $(READY)
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m "not slow and not thorough" -n auto --dist loadfile

test-thorough: $(READY)
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m "thorough and not slow" -n auto --dist load

test-slow: $(READY)
	$(BIN)/python -m pytest -m slow

bench: $(READY)
	$(BIN)/python -m benchmarks

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

docs: $(READY)
	$(BIN)/python docs/reference.py out/docs

lock:
	$(BIN)/uv pip compile --universal --python-version 3.11 --all-extras --generate-hashes \
		--no-header --no-annotate pyproject.toml --output-file requirements.lock

plant: $(READY)
	$(BIN)/python -m deploy.plant

chaos: $(READY)
	OMP_NUM_THREADS=1 PYTHONPATH=tests $(BIN)/python -m benchmarks.chaos

clean:
	rm -rf $(VENV) build dist *.egg-info
