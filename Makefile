# eulerparams_control: each target sets up .venv by itself.

SHELL := /bin/bash
VENV := .venv
PYTHON := $(VENV)/bin/python
READY := $(VENV)/.ready
OUT ?= out
JOBS ?=

export ROS_PYTHON_CHECK_FIELDS ?= 1
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
unexport PYTHONDONTWRITEBYTECODE  # or each process of a run or a test compiles all anew

.PHONY: setup demo test test-long bench bench-motion paper map faults soak two-hosts lint clean

setup: $(READY)

$(READY): setup.py setup.cfg package.xml tools/setup
	@bash tools/setup $(VENV)

demo: $(READY)
	@rm -rf $(OUT)/demo
	@$(VENV)/bin/experiment demo --out $(OUT)

test: $(READY)
	@$(PYTHON) -m pytest -n 2 --dist loadfile -m "not slow" \
	  --hypothesis-profile quick --durations 20 $(ARGS)

# One after the other: many of these tests run in real time. Fuzzing has all its examples here.
test-long: $(READY)
	@$(PYTHON) -m pytest -m "slow or hypothesis" --durations 20 $(ARGS)

# As users run it, without the checks of fields.  Some minutes; see ARGS=--help.
bench: $(READY)
	@env -u ROS_PYTHON_CHECK_FIELDS $(PYTHON) benchmarks/run.py --page $(OUT)/bench.html $(ARGS)

# Some minutes: what is commanded when references leap, stall or come with noise.
bench-motion: $(READY)
	@$(PYTHON) benchmarks/bench_motion.py $(ARGS)

paper: $(READY)
	@$(VENV)/bin/experiment --paper $(if $(JOBS),--jobs $(JOBS)) --out $(OUT)/paper $(ARGS)

map: $(READY)
	@$(VENV)/bin/failure_map --out $(OUT)/map $(ARGS)

faults: $(READY)
	@$(VENV)/bin/fault_campaign --out $(OUT)/faults $(if $(JOBS),--jobs $(JOBS)) $(ARGS)

soak: $(READY)
	@rm -rf $(OUT)/soak
	@$(PYTHON) -m eulerparams_control.lab.experiments.soak --out $(OUT)/soak $(ARGS)

two-hosts: $(READY)
	@tools/two_hosts --out $(OUT)/two_hosts $(ARGS)

lint: $(READY)
	@$(VENV)/bin/ruff check .
	@$(VENV)/bin/mypy eulerparams_control sim_bridge

clean:
	rm -rf $(VENV) $(OUT) build install log *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
