# eulerparams_control: `make demo` and `make test` set up .venv by themselves.

SHELL := /bin/bash
VENV := .venv
PYTHON := $(VENV)/bin/python
READY := $(VENV)/.ready
OUT ?= out
PAPER := e3 e4 e6 e7 e8 e9 e10 e11 e12 e13 e14 e15 e16 e17 e18 e19 e20 e21 robots encoders turning \
	press_slide peg hand_guiding admittance contact_stiffness robots_contact

export ROS_PYTHON_CHECK_FIELDS ?= 1
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST

.PHONY: setup demo test bench paper lint clean

setup: $(READY)

$(READY): setup.py setup.cfg package.xml tools/setup
	@bash tools/setup $(VENV)

demo: $(READY)
	@rm -rf $(OUT)/demo
	@$(VENV)/bin/experiment demo --out $(OUT)

test: $(READY)
	@$(PYTHON) -m pytest $(ARGS)

bench: $(READY)
	@$(PYTHON) benchmarks/run.py

paper: $(READY)
	@rm -rf $(OUT)/paper
	@$(VENV)/bin/experiment $(PAPER) --out $(OUT)/paper

lint: $(READY)
	@$(VENV)/bin/ruff check .
	@$(VENV)/bin/mypy eulerparams_control sim_bridge

clean:
	rm -rf $(VENV) $(OUT) build install log *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
