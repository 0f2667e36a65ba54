# eulerparams_control: each target sets up .venv by itself.

SHELL := /bin/bash
VENV := .venv
PYTHON := $(VENV)/bin/python
FIRST := $(VENV)/.first
READY := $(VENV)/.rest
FLOOR := .venv-floor
# Laws, nodes, bags, analysis: what calls the libraries whose versions differ.
FLOOR_TESTS := rotations orientation dynamic impedance impedance_metrics analysis analyze static_figures \
  bag_format bag_recorder rviz nodes impedance_node
OUT ?= out
JOBS ?=

export ROS_PYTHON_CHECK_FIELDS ?= 1
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
unexport PYTHONDONTWRITEBYTECODE  # or each process of a run or a test compiles all again

.PHONY: setup demo live test test-long test-floor floor-tests bench paper compare yardstick yardstick-paper docs picture lint clean

setup: $(READY)

$(FIRST): setup.py setup.cfg package.xml tools/setup
	@bash tools/setup $(VENV) first

$(READY): $(FIRST)
	@bash tools/setup $(VENV) rest

# It needs a part of the set-up only.
demo: $(FIRST)
	@rm -rf $(OUT)/demo
	@$(VENV)/bin/experiment demo --out $(OUT)

# A page on which a person moves a simulated arm; ARGS="--controller clik --robot panda".
live: $(READY)
	@$(VENV)/bin/live $(ARGS)

test:
	@$(PYTHON) -m pytest -n 2 --dist loadfile -m "not slow" \
	  --hypothesis-profile quick --durations 20 $(ARGS)

# One after the other: many of these tests run in real time. Fuzzing has all its examples here.
test-long:
	@$(PYTHON) -m pytest -m "slow or hypothesis" --durations 20 $(ARGS)

# With the oldest libraries that the package runs with: what ROS 2 Jazzy has on Ubuntu 24.04.
$(FLOOR)/.floor: setup.py setup.cfg package.xml tools/setup tools/floor.txt
	@bash tools/setup $(FLOOR) floor

test-floor: $(FLOOR)/.floor
	@$(FLOOR)/bin/python -m pytest -n 2 --dist loadfile -m "not slow" --hypothesis-profile quick \
	  --durations 10 $(FLOOR_TESTS:%=test/test_%.py) $(ARGS)

floor-tests:
	@echo $(FLOOR_TESTS:%=test/test_%.py)

# As users run it, without the checks of fields.  Each script has --help.
bench:
	@for name in tick node simulation; do \
	  env -u ROS_PYTHON_CHECK_FIELDS $(PYTHON) benchmarks/$$name.py || exit; done

paper: $(READY)
	@$(VENV)/bin/experiment --paper $(if $(JOBS),--jobs $(JOBS)) --out $(OUT)/paper $(ARGS)

# Which law is in your controller?
compare: $(READY)
	@$(VENV)/bin/experiment --compare $(if $(JOBS),--jobs $(JOBS)) --out $(OUT)/compare $(ARGS)

# What the laws command, beside what they did; ARGS=--write keeps that of now: docs/contributing.md.
yardstick:
	@$(PYTHON) test/yardstick.py $(ARGS)

# The same of the experiments, after make paper and make compare.
yardstick-paper: $(READY)
	@$(PYTHON) test/yardstick_paper.py $(ARGS) $(OUT)/paper $(OUT)/compare

docs: $(READY)
	@NO_MKDOCS_2_WARNING=1 $(VENV)/bin/mkdocs build --strict --quiet --site-dir $(OUT)/docs
	@echo "The site: $(OUT)/docs/index.html"

picture: $(READY)
	@[ -d $(OUT)/demo/clik_euler_parameters ] || $(MAKE) demo
	@$(PYTHON) tools/picture.py $(OUT)/demo/clik_euler_{angles,parameters} docs/pole.webp

lint: $(READY)
	@$(VENV)/bin/ruff check .
	@$(VENV)/bin/mypy eulerparams_control sim_bridge

clean:
	rm -rf $(VENV) $(FLOOR) $(OUT) build install log *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
