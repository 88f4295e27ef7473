# make demo   sets everything up and runs the tunnel task with the whole node graph
# make test   sets everything up and runs all tests
# make fuzz   more random faults in everything that comes from outside
# make lint   checks style (ruff) and types (mypy)
# make bench  measures the optimiser against RAI's, which it installs (needs the system's liblapack3)
# make bench-peers  compares planners of others, RAI's and HPP's, with hmap's, in environments of their own
# make bench-startup  measures how long the command and the graph of nodes take to start
# make setup  only sets up: .venv, with the command .venv/bin/hmap
#
# Every step leaves a stamp in .venv/stamps and is done again only when what it depends on has changed.

PYTHON ?= $(shell command -v python3.11 || echo python3)
VENV := .venv
STAMPS := $(VENV)/stamps
PIP := $(VENV)/bin/pip --disable-pip-version-check
SOURCES := ros2_ws/src
PACKAGES := $(SOURCES)/hmap_scenes $(SOURCES)/hmap_core hmap_msgs_py $(SOURCES)/hmap

INTERFACE_FILES := $(shell find $(SOURCES)/hmap_msgs $(SOURCES)/compat -type f) cmake/ros_wheels.cmake colcon.meta tools/build_interfaces.sh
CORE_FILES := $(shell find $(SOURCES)/hmap_core/hmap_core -name '*.py')

.DELETE_ON_ERROR:
.PHONY: setup demo test fuzz bench bench-peers bench-startup lint lock clean

setup: $(STAMPS)/packages $(STAMPS)/precompiled

demo: setup
	$(VENV)/bin/hmap up tunnel --seed 0

# Tests of one process run on two cores; after them, those that start graphs of nodes have the machine to themselves.
GRAPHS := tests/system tests/hardware tests/examples
test: setup lint
	tools/browser.sh
	ROS_PYTHON_CHECK_FIELDS=1 $(VENV)/bin/pytest -n 2 --dist loadfile $(addprefix --ignore=,$(GRAPHS)) $(PYTEST_ARGS)
	ROS_PYTHON_CHECK_FIELDS=1 $(VENV)/bin/pytest $(GRAPHS) $(PYTEST_ARGS)

# More of what `make test` does for some seconds: random faults in everything that comes from outside.
fuzz: setup
	HMAP_FUZZ_SECONDS=120 HMAP_FUZZ_SEED=$$(date +%s) $(VENV)/bin/pytest tests/fuzz

bench: setup
	$(PIP) install --quiet --no-deps robotic==0.4.2
	$(VENV)/bin/hmap bench komo $(BENCH_ARGS)

# RAI's and HPP's planners beside hmap's, in environments of their own; what cannot be installed is left out.
bench-peers: setup
	tools/bench_peers.sh $(VENV) $(PYTHON) $(BENCH_ARGS)

bench-startup: setup
	$(VENV)/bin/hmap bench startup $(BENCH_ARGS)

lint: $(STAMPS)/dependencies
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy

$(STAMPS)/dependencies: requirements.lock tools/system_libraries.sh
	tools/system_libraries.sh $(PYTHON)
	test -x $(VENV)/bin/python || $(PYTHON) -m venv $(VENV)
	$(PIP) install --quiet --no-deps --no-compile -r requirements.lock
	$(VENV)/bin/python -m compileall -q -j 0 -x /torch/testing/ $(VENV)/lib  # which is of a later Python in part
	mkdir -p $(STAMPS) && touch $@

$(STAMPS)/interfaces: $(STAMPS)/dependencies $(INTERFACE_FILES)
	tools/build_interfaces.sh $(VENV)
	touch $@

# "compat": a plain path entry. The finder that is the default would lose to a folder of the package's name in the
# working directory, as hmap_msgs_py has one here.
$(STAMPS)/packages: $(STAMPS)/interfaces $(addsuffix /setup.py,$(PACKAGES))
	PYTHONWARNINGS=ignore $(PIP) install --quiet --no-deps --no-build-isolation --config-settings editable_mode=compat \
		$(addprefix --editable ,$(PACKAGES))
	touch $@

# Compiles Python's bytecode, and the planner's hot loops into the caches, so that no user waits for it.
$(STAMPS)/precompiled: $(STAMPS)/packages $(CORE_FILES)
	$(VENV)/bin/python -m compileall -q $(PACKAGES)
	$(VENV)/bin/python -m hmap_core.precompile
	touch $@

# Renews requirements.lock from requirements.txt, in an environment of its own.
lock:
	rm -rf .venv-lock && $(PYTHON) -m venv .venv-lock
	.venv-lock/bin/pip install --quiet -r requirements.txt
	.venv-lock/bin/python tools/lock.py > requirements.lock
	rm -rf .venv-lock

clean:
	rm -rf $(VENV) .venv-lock .venv-peers .venv-hpp ros2_ws/build ros2_ws/install ros2_ws/log
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
	find . -name '*.egg-info' -type d -prune -exec rm -rf {} +
