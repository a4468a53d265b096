PYTHON ?= python3
JOBS ?= 2
BIN := .venv/bin
READY := .venv/.ready

.DEFAULT_GOAL := help
.PHONY: help setup demo test lint format bench bench-full figures lock clean

help: ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: $(READY) ## make .venv with the locked dependencies and this package, editable

$(READY): requirements.lock pyproject.toml setup.py
	test -x $(BIN)/pip || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation -e .
	touch $@

demo: setup ## deform the sample meshes; pictures and meshes go to demo/
	scripts/system-libraries
	$(BIN)/oneform-warp demo

test: lint ## lint, compile the kernels for a GPU (none needed), run the tests
	$(BIN)/python tests/compile_kernels.py
	$(BIN)/python -m pytest -n $(JOBS)

lint: setup ## check style, format and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: setup ## format the code and apply safe fixes
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: setup ## the short benchmarks
	$(BIN)/python -m bench

bench-full: setup ## all benchmarks (needs a GPU)
	$(BIN)/python -m bench --full

figures: setup ## draw the figures of the paper into figures/
	$(BIN)/python -m examples

lock: setup ## bring requirements.lock up to date (needs uv)
	uv pip compile --quiet --upgrade --universal --generate-hashes --no-emit-index-url --no-emit-find-links \
		--no-header --extra preview --extra test --extra cholmod --extra cluster pyproject.toml -o requirements.lock

clean: ## remove what was built; .venv stays
	rm -rf build dist demo *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +
