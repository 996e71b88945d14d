# Entry point for developers. `make help` lists the targets; `make demo` and `make test` need only python3 (3.11 or newer).
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
MAKEFLAGS += --no-print-directory

PYTHON ?= python3
# Without PYTHON=..., .venv may use a faster build of the same Python version.
SETUP = $(PYTHON) tools/setup_environment.py $(if $(filter file,$(origin PYTHON)),,--this-python) --extras '$(EXTRAS)'
PY := .venv/bin/python
# One process more than two cores, because some tests wait for servers, time limits and other processes.
JOBS ?= 3
ARGS ?=
# Names of extras for .venv, as in `make setup EXTRAS="train lerobot"`. The environment keeps them.
EXTRAS ?=
# One thread per process, because threads of the software renderer and of small matrix products do not scale.
# The setup script stores the GL back end that works here; MUJOCO_GL of the caller takes precedence.
# Bytecode is kept, because the tests start many processes, and each would compile the package again.
RUN = PYTHONDONTWRITEBYTECODE= MUJOCO_GL="$${MUJOCO_GL:-$$(cat .venv/mujoco-gl)}" LP_NUM_THREADS=0 OMP_NUM_THREADS=1
TESTS = $(PY) tools/run_tests.py -q -n $(JOBS)

.PHONY: help setup env demo test test-slow bench golden certify check fmt fmt-check lint types arch docs site wheel lock clean distclean

help: ## list these targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | while IFS=$$'\t' read -r word text; do printf '  %-10s %s\n' "$$word" "$$text"; done

setup: ## make .venv from the hash-pinned locks, and the GL library; EXTRAS="train lerobot" adds extras
	@$(SETUP)

env:
	@$(SETUP) --no-gl

demo: setup ## evaluate the expert and three policies with known faults, diagnose them, and write runs/demo/report
	@$(RUN) $(PY) -m betterbench.cli demo --out runs/demo $(ARGS)

test: setup ## run the default tests on JOBS=3 processes; ARGS="-k name" goes to pytest, ARGS=--again repeats failed tests
	@$(RUN) $(TESTS) --dist loadscope $(ARGS)

test-slow: setup ## run the slow tests
	@$(RUN) $(TESTS) -m "slow and not gpu and not network and not llm" $(ARGS)

bench: setup ## measure the speed as ratios within one run
	@$(RUN) $(PY) benchmarks/bench.py $(ARGS)

golden: setup ## rewrite the golden files and print what changed
	@$(RUN) $(PY) -m pytest -q -m golden --regenerate-golden $(ARGS)

certify: setup ## measure the demonstrations and certify the default trials of all suites; rewrite the packaged files
	@$(RUN) $(PY) -m betterbench.cli certify --out runs/certificate --demonstrations 120 --write-package
	@$(RUN) $(PY) -m betterbench.cli certify --out runs/certificate --write-package $(ARGS)
	@$(RUN) $(PY) -m betterbench.cli certify --suite real_world --out runs/certificate_real --demonstrations 120 --write-package
	@$(RUN) $(PY) -m betterbench.cli certify --suite real_world --out runs/certificate_real --write-package $(ARGS)
	@$(RUN) $(PY) -m betterbench.cli certify --suite so101 --out runs/certificate_so101 --demonstrations 120 --write-package
	@$(RUN) $(PY) -m betterbench.cli certify --suite so101 --out runs/certificate_so101 --write-package $(ARGS)

check: fmt-check lint types arch ## run all quick checks; no simulation

fmt: env ## format, sort imports, apply safe fixes
	@$(PY) -m ruff format
	@$(PY) -m ruff check --fix-only --quiet

fmt-check: env
	@$(PY) -m ruff format --check

lint: env ## run ruff
	@$(PY) -m ruff check

types: env ## run mypy in strict mode
	@$(PY) -m mypy

arch: env ## check the import contracts
	@.venv/bin/lint-imports

docs: setup ## regenerate pages and pictures of the documentation
	@$(RUN) $(PY) tools/make_docs.py $(ARGS)

site: env ## build the documentation as a site into site/, and check every link
	@$(PY) tools/make_site.py $(ARGS)

wheel: setup ## build the wheel into dist/, install it in a clean environment, and run `better demo` there
	@$(RUN) $(PY) tools/check_wheel.py $(ARGS)

lock: ## rewrite requirements/*.lock; ARGS=--upgrade takes the newest versions
	@$(SETUP) --relock $(ARGS)

clean: ## remove caches and build output
	@rm -rf build dist site .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis
	@find src tests tools benchmarks -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true

distclean: clean ## remove the environment too
	@rm -rf .venv .uv .setup.lock
