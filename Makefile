# Everything here runs in .venv, which is made on the way: python3, python3-venv and make are
# all that has to be there. Another Python: make PYTHON=python3.12 test

PYTHON := python3
ARGS :=
ROOM := rig
COUNT := 60
PY := .venv/bin/python
VENV := PYTHON='$(PYTHON)' .ci/venv

# A sourced ROS 2 or another active environment must not reach into .venv.
unexport AMENT_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONHOME PYTHONPATH VIRTUAL_ENV
unexport PIP_REQUIRE_VIRTUALENV PIP_TARGET PIP_USER _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport RMW_IMPLEMENTATION ROS_DISCOVERY_SERVER ROS_LOCALHOST_ONLY ROS_NAMESPACE
# The tests start hundreds of processes, and each would compile the whole package to byte code.
unexport PYTHONDONTWRITEBYTECODE
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: bench clean colcon demo dist docs env format help lint mutants page release test types

help:  ## this list
	@sed -n 's/^\([a-z]*\):.*## /  make \1\t/p' $(firstword $(MAKEFILE_LIST)) | expand -t 16

demo:  ## run the live rig for half a minute, record it, compare it with theory: see demo_run/
	@$(VENV) ros,plot
	@$(PY) -u examples/demo.py $(ARGS)

page:  ## the live rig in a browser: starts node and page, prints and opens the address
	@$(VENV) ros,plot,page,sweep
	@$(PY) -m impact_damper_ros.cli.rig_page --start bench_rig --open $(ARGS)

test:  ## run all tests
	@$(VENV) ros,plot,test
	@$(PY) -m pytest $(ARGS)

dist:  ## build source distribution and wheel into dist/, and check what PyPI would show
	@$(VENV) ros,plot,test,dev
	@rm -rf dist
	@$(PY) -m build --no-isolation . >/dev/null
	@rm -rf build/lib build/bdist.*
	@$(PY) -m twine check --strict dist/*

release: dist  ## rehearse a release: install the distributions into empty environments, try all, list what is left to do
	@$(PY) .ci/release $(ARGS)

docs:  ## write the generated parts of the documentation, and build it into docs/_build/html
	@$(VENV) ros,plot,test,dev,docs
	@$(PY) docs/generated.py
	@$(PY) -m sphinx -q -E -W --keep-going -b html docs docs/_build/html
	@echo "The documentation is in docs/_build/html/index.html"

lint:  ## check the style (ruff)
	@$(VENV) ros,plot,test,dev
	@$(PY) -m ruff check .
	@$(PY) -m ruff format --check .

format:  ## put the code into style (ruff)
	@$(VENV) ros,plot,test,dev
	@$(PY) -m ruff check --fix .
	@$(PY) -m ruff format .

types:  ## check the types (mypy --strict)
	@$(VENV) ros,plot,test,dev
	@$(PY) -m mypy

colcon:  ## build with colcon into build/ and install/, as in a ROS 2 workspace
	@$(VENV) ros,plot,test
	@$(PY) -m colcon build

mutants:  ## alter operators of a room, and see whether its tests notice: ROOM=rig COUNT=60
	@$(VENV) ros,plot,test,dev
	@$(PY) test/mutants.py $(ROOM) --count $(COUNT) $(ARGS)

bench:  ## measure speed, accuracy and jitter against general tools (some minutes)
	@$(VENV) ros,plot,test
	@$(PY) benchmarks/simulator.py $(ARGS)
	@$(PY) benchmarks/orbits.py $(ARGS)
	@$(PY) benchmarks/compare_run.py
	@$(PY) benchmarks/node.py $(ARGS)

env:  ## only make .venv, with all tools for development
	@$(VENV) ros,plot,test,dev,docs

clean:  ## remove .venv, builds, caches and the demo's run
	rm -rf .venv build docs/_build install log demo_run *.egg-info .mypy_cache .pytest_cache .ruff_cache
	find impact_damper_ros test benchmarks docs -name __pycache__ -type d -prune -exec rm -rf {} +
