# make demo   the node holds a wire of the virtual bench at setpoints, live in the terminal (VIEW=1: in the browser too)
# make test   the tests; make long-tests those that take longer
# make check  format, lint, types and the storeys of the house
# make floor  what the tests of the rooms that say what current may flow reach of them
# make counterparts   the driver against instruments that others wrote (FOREIGN_PYTHON=python3.12 for one of them)
# make release  sdist and wheel, tried from the wheel
# make fuzz   every parser of files and messages (MINUTES=60)
# make audit, make sbom   published holes in what is installed; its bill of materials
# make docs   the documentation with the API reference, warnings are errors
# make tables, make benchmarks, make coefficients   the figures and the models, made again
# All do their own set-up: a virtual environment with pinned ROS 2 wheels in .venv.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DURATION ?= 60
WIRE ?= flexinol
EXTRAS := ros,speed,report,view,foxglove,bags,baselines,pymeasure,fleet,formats,completion,test,check,docs

# A test run starts some hundred interpreters, none of which is to compile the sources again, whatever the environment
# says.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: fuzz audit sbom release counterparts page attack mutants demo test long-tests check docs coverage floor \
    results pictures tables benchmarks coefficients blind-trial own-baseline whole-range control-worlds \
    feed-forward tuning pair fleet foreign-speed tutorial forward health clean

demo: $(VENV)/ready
	$(BIN)/sma-actuator demo --wire $(WIRE) --duration $(DURATION) $(if $(VIEW),--view)

# Most tests wait for processes: six beside the two cores cost nothing.  A class, or a file's functions, stay together.
test: $(VENV)/ready viewers
	$(BIN)/python -m pytest -n 6 --dist loadscope --no-loadscope-reorder -m "not long" --durations=10

long-tests: $(VENV)/ready
	$(BIN)/python -m pytest -n 2 -m long

counterparts: $(VENV)/ready .counterparts/ready
	$(BIN)/python -m pytest tests/counterparts -rs

.PHONY: micropython
# MicroPython for Node, which runs the board's firmware in tests (docs/board.md).
micropython:
	npm install --prefix .node --no-save --no-audit --no-fund @micropython/micropython-webassembly-pyscript@1.27.0

.PHONY: viewers
# Packages of Foxglove's for Node, pinned by package-lock.json, which open recordings in tests; without Node those
# tests skip.
VIEWERS := tests/viewers/node_modules/.package-lock.json
viewers: $(VIEWERS)
$(VIEWERS): tests/viewers/package-lock.json
	@if command -v npm >/dev/null && npm ci --prefix tests/viewers --no-audit --no-fund --ignore-scripts; then touch $@; \
	else echo "npm has not brought them: what others' viewers make of recordings is not tried"; fi

FOREIGN_PYTHON ?= $(PYTHON)
.counterparts/ready: tests/counterparts/requirements.txt
	$(FOREIGN_PYTHON) -m venv .counterparts
	.counterparts/bin/python -m pip install --quiet --requirement $<
	touch $@

check: $(VENV)/ready
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(VENV)/ready
	$(BIN)/python -m sphinx -b html --fail-on-warning --keep-going docs docs/_build

# sdist and wheel in dist/, tried in an empty environment; all but the upload
release:
	PYTHON=$(PYTHON) .ci/release

coverage: $(VENV)/ready
	$(BIN)/python benchmarks/coverage_by_room.py

# The rooms that say what current may flow, by their own tests, each above its floor.
floor: $(VENV)/ready
	$(BIN)/python benchmarks/coverage_by_room.py --guards

# One make at a time makes it, and who comes meanwhile waits for that one: `make demo` in one terminal, `make test` in
# another.
$(VENV)/ready: setup.py constraints.txt requirements.lock
	@flock --nonblock Makefile true || echo "another make makes $(VENV): waiting for it"
	@flock Makefile $(MAKE) --no-print-directory $(VENV)/installed
	@touch $@

$(VENV)/installed: setup.py constraints.txt requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is wanted; set PYTHON=python3.12 or so"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' || { echo "the venv module is missing: apt-get install python3-venv"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --require-hashes --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[$(EXTRAS)]'
	touch $@

# Every figure of README.md and the pages in docs comes from one of these; the names of some sections in RESULTS.
RESULTS ?=
results: $(VENV)/ready
	$(BIN)/python benchmarks/results.py $(RESULTS)

tables: $(VENV)/ready
	$(BIN)/python benchmarks/control_tables.py
	$(BIN)/python benchmarks/replay_tables.py

pictures: $(VENV)/ready
	$(BIN)/python examples/draw_a_loop.py docs/pictures/loop.png

# The page of the node in a headless Chromium: its picture, and whether its memory stays what it is.
MINUTES ?= 30
page: $(VENV)/ready
	$(BIN)/python benchmarks/page.py --minutes $(MINUTES) --picture docs/pictures/view.png

benchmarks: $(VENV)/ready
	$(BIN)/python benchmarks/cost.py
	$(BIN)/python benchmarks/loop.py
	$(BIN)/python benchmarks/replay_speed.py

# Characterise the wires of the virtual bench and identify the four models in config/.
coefficients: $(VENV)/ready
	$(BIN)/python benchmarks/coefficients.py

# Trace sessions with effects hidden in them, and judge what is said (about 20 minutes); the trial's own options in
# TRIAL.
TRIAL ?=
blind-trial: $(VENV)/ready
	$(BIN)/python benchmarks/blind_trial.py $(TRIAL)

# What the models lack over the whole range even on the wires they were identified on, and what adding it buys.
own-baseline: $(VENV)/ready
	$(BIN)/python benchmarks/own_baseline.py

# The whole-range model beside the thesis's, per physics of the bench (about half an hour; options in WHOLE).
WHOLE ?=
whole-range: $(VENV)/ready
	$(BIN)/python benchmarks/whole_range.py $(WHOLE)

# The judge of the control loop: init, characterise, identify, init, drive, in eight designed and 24 drawn physics,
# both alloys, both laws.  Two minutes of one core for each wire and half a minute for each law that drives it: three
# hours in all the first time; what is stopped goes on where it was.  A sample in CONTROL: --physics foreign
# drawn-117, or --every 4.
CONTROL ?=
control-worlds: $(VENV)/ready
	$(BIN)/python benchmarks/control_worlds.py $(CONTROL)

# What feed-forward takes off the error of the PID, per physics, also with a model whose heat is wrong (a quarter of
# an hour the first time; options in FORWARD_LAW).
FORWARD_LAW ?=
feed-forward: $(VENV)/ready
	$(BIN)/python benchmarks/feed_forward.py $(FORWARD_LAW)

# Gains tuned from ten times off, beside the shipped ones, per physics of the bench (a quarter of an hour the first
# time; options in TUNING).
TUNING ?=
tuning: $(VENV)/ready
	$(BIN)/python benchmarks/tuning.py $(TUNING)

# Angle and co-contraction of a joint that two wires turn (a minute; other physics in PAIR).
PAIR ?=
pair: $(VENV)/ready
	$(BIN)/python benchmarks/pair.py $(PAIR)

# What the driver says of its model's health: false alarms in virtual hours on every physics, then drifts in growing
# strength.
health: $(VENV)/ready
	$(BIN)/python benchmarks/health.py --wire flexinol furukawa
	$(BIN)/python benchmarks/health.py --drifts

# Judge the logs of a fleet over a Dask cluster and an S3-compatible server, a worker killed on the way (options in
# FLEET).
FLEET ?=
fleet: $(VENV)/ready
	$(BIN)/python benchmarks/fleet.py $(FLEET)

# Run the commands of the tutorial again, and put what they print into its page.
tutorial: $(VENV)/ready
	$(BIN)/python docs/tutorials/run.py

# Time to identify and to trace logs of a foreign physics, and how it grows with their samples (options in SPEED).
SPEED ?=
foreign-speed: $(VENV)/ready
	$(BIN)/python benchmarks/foreign_speed.py $(SPEED)

# Fit the forward model to measurements of a real bench, and name what it lacks.
FORWARD_DATA ?= ../shared/data/flexinol_050_bench
FORWARD_RUNS ?= $(wildcard $(FORWARD_DATA)/*.csv)

forward: $(VENV)/ready
	@test -n "$(FORWARD_RUNS)" || { echo "no runs in $(FORWARD_DATA); set FORWARD_DATA to a folder of CSV files"; exit 1; }
	$(BIN)/sma-actuator forward $(FORWARD_RUNS) --wire config/flexinol_050_forward.yaml --out out/forward --force

# Attack the driver at random for as long as ATTACK says (--minutes 60), go on where the last stopped, keep it with
# its commit, and write what held to docs/attack.md.
ATTACK ?=
attack: $(VENV)/ready
	nice -n 5 $(BIN)/python -m attack $(ATTACK)

# Change what guards the wire, one place at a time, and see that a test notices (hours; MUTANTS: targets, or --minutes
# 8; it goes on where it was).
MUTANTS ?=
mutants: $(VENV)/ready
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[mutants]'
	nice -n 5 $(BIN)/python benchmarks/mutants.py $(MUTANTS)

# The packages of requirements.lock (written by .ci/lock) against what is published of holes in them; asks osv.dev.
audit: $(VENV)/ready
	$(BIN)/python -m pip install --quiet 'pip-audit>=2.7,<3'
	.ci/audit $(BIN)

# What is in the environment, as a bill of materials (CycloneDX): out/sbom.json.
sbom: $(VENV)/ready
	$(BIN)/python -m pip install --quiet 'cyclonedx-bom>=7,<8'
	mkdir -p out
	$(BIN)/cyclonedx-py requirements requirements.lock --output-reproducible --of JSON -o out/sbom.json

# Feed every parser with inputs that reach new lines of it (MINUTES for all of them; PARSERS: some; what breaks one
# joins attack/corpus).
PARSERS ?=
fuzz: $(VENV)/ready
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[fuzz]'
	nice -n 5 $(BIN)/python -m attack.parsers $(PARSERS) --minutes $(MINUTES)

clean:
	rm -rf $(VENV) .counterparts .node tests/viewers/node_modules build install log out
