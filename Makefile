.PHONY: comparison fmi-reference help demo release-check lint-workflows test test-rest test-engine test-faults nightly fresh test-unit test-slow chaos coverage examples examples-c examples-rust robots robots-page pictures check docs bench soak campaign simulate clean setup setup-demo
.NOTPARALLEL:  # `make -j demo test` would install twice at a time

PYTHON := .venv/bin/python

help:
	@echo "make setup      create .venv with python3.11 or python3; PYTHON3=python3.13 selects another"
	@echo "make demo       install what a run needs, run the two-link arm for 10 s and plot it"
	@echo "make test       install the rest, run the fast tests"
	@echo "make fresh      run both in an empty clone, with only Python, make and git on the PATH"
	@echo "make test-rest  run the fast tests that make fresh FRESH='--passed F' did not: BUT=F"
	@echo "make test-engine run the tests of the plant with MuJoCo: ENGINE=mujoco"
	@echo "make test-unit  run the tests that start no process, in under a minute"
	@echo "make test-faults run the slow tests of faults, a second user, a full disk (part of test-slow)"
	@echo "make test-slow  run the slow tests"
	@echo "make nightly    run all that .ci/run leaves out (1 h)"
	@echo "make coverage   run the fast tests and show which lines they execute"
	@echo "make chaos      inject two hundred faults (part of test-slow)"
	@echo "make check      check formatting, lint, types, imports, generated files, changelog, workflows"
	@echo "make docs       build the documentation site into build/docs"
	@echo "make pictures   make every picture in the docs and the gallery from real runs (Chromium; 7 min)"
	@echo "make examples   build the controllers in C and Rust (Rust: several minutes the first time)"
	@echo "make robots     install stepbus-store, with the robots of store and baxter (414 MB)"
	@echo "make robots-page load robots of other packages and make the page of their numbers (200 MB; 15 min)"
	@echo "make simulate   simulate 10,000 runs with random faults (4 min)"
	@echo "make campaign   judge real runs with 40 external faults, and 80 sales (30 min)"
	@echo "make release-check try the release as its users will: build, install, run (20 min)"
	@echo "make lint-workflows check the GitHub workflows and the citation (part of check)"
	@echo "make bench      measure steps/s and CPU time, compared with HELICS, mosaik and hand-written chains"
	@echo "make comparison run one small task in stepbus and in its peers, each in its own environment (10 min)"
	@echo "make fmi-reference compare the Reference FMUs that you have built, in REFERENCE_FMUS, with their results"
	@echo "make soak       run a million steps: checks that memory stays constant and reports stay fast (5 min)"
	@echo "make clean      remove .venv and caches; keep runs/"

demo: setup-demo
	@$(PYTHON) -c "import sys; from importlib.util import find_spec; find_spec('pybullet') or print( \
		'the physics engine is MuJoCo: PyBullet has no wheel for Python %d.%d' % sys.version_info[:2])"
	@.venv/bin/stepbus run two_link

# Parallel tests: use `make test WORKERS=8` on a bigger machine. Four workers keep two cores busy,
# since many fast tests wait for a deadline or for a process to start.
WORKERS := 2

test: WORKERS := 4
test-slow: WORKERS := 3
test: setup
	@$(PYTHON) -m pytest -n $(WORKERS) --dist worksteal

# Tests that `make fresh` could not run: those that need more than Python, make and git, and those of the store.
test-rest: setup
	@$(PYTHON) -m pytest -n 3 --dist worksteal --but=$(BUT)

# The commands above as a new user runs them; `make fresh FRESH=--help` lists the options.
fresh:
	@python3 scripts/fresh.py $(FRESH)

# Tests of the plant in another engine than the default.
ENGINE := mujoco
test-engine: setup
	@$(PYTHON) -m pytest -n 3 --dist worksteal --engine $(ENGINE) tests/services/plant tests/scenarios

test-unit: setup
	@$(PYTHON) -m pytest --unit

# Property tests also run on fresh examples; `make test-slow FRESH_EXAMPLES=` skips that, for the same verdict
# everywhere.
FRESH_EXAMPLES := --fresh-examples

# pytest exits with 5 if there are no such tests.
# Clients of CoppeliaSim, without what their packages depend on: an abandoned library, a whole simulator.
test-slow: setup
	@$(PYTHON) -m pip install --disable-pip-version-check -q --no-deps coppeliasim-zmqremoteapi-client==2.0.4 guira==0.1.0
	@$(PYTHON) -m pytest -m slow -n $(WORKERS) --dist worksteal || [ $$? -eq 5 ]
	@[ -z "$(FRESH_EXAMPLES)" ] || $(PYTHON) -m pytest -m hypothesis $(FRESH_EXAMPLES) --timeout 1200

test-faults: setup
	@$(PYTHON) -m pytest -m slow -n 3 --dist worksteal tests/orchestrator/faults --ignore tests/orchestrator/faults/test_chaos.py

# What .ci/run leaves out, in samples of fixed size; `make campaign` and `make release-check` have more parts.
nightly: setup robots
	@scripts/install_toolchains.sh
	@$(MAKE) --no-print-directory release-check
	@$(MAKE) --no-print-directory pictures PICTURES=--check
	@$(MAKE) --no-print-directory examples
	@$(MAKE) --no-print-directory simulate SIMULATE='--runs 10000 --seed 3'
	@$(MAKE) --no-print-directory campaign PART=campaign/test_runs.py CAMPAIGN='--seed=3 --count=30 --patience=2.5'
	@$(MAKE) --no-print-directory campaign PART=campaign/store CAMPAIGN='--seed=3 --count=20'
	@$(MAKE) --no-print-directory test-slow FRESH_EXAMPLES=

# A checkout of modelica/Reference-FMUs, in which you have built the FMUs as its README says; FMUS=folders elsewhere.
fmi-reference: setup
	@$(PYTHON) guests/fmi/tests/reference.py \
		$(or $(REFERENCE_FMUS),$(error REFERENCE_FMUS is the folder of your checkout of modelica/Reference-FMUs)) $(FMUS)

chaos: setup
	@$(PYTHON) -m pytest -m slow tests/orchestrator/faults/test_chaos.py

check: setup
	@$(PYTHON) -m ruff format --check .
	@$(PYTHON) -m ruff check .
	@$(PYTHON) -m mypy
	@.venv/bin/lint-imports
	@PYTHONPATH=store .venv/bin/lint-imports --config store/pyproject.toml
	@$(PYTHON) -m scripts.generate_messages --check
	@$(PYTHON) -m scripts.generate_parameters --check
	@$(PYTHON) scripts/check_changelog.py
	@$(PYTHON) scripts/check_budget.py
	@$(MAKE) --no-print-directory lint-workflows

coverage: setup
	@$(PYTHON) -m coverage erase
	@$(PYTHON) -m coverage run -m pytest; code=$$?; \
		$(PYTHON) -m coverage combine -q; $(PYTHON) -m coverage report; exit $$code

docs: setup
	@$(PYTHON) -m pip install --disable-pip-version-check -q -c constraints.txt -e '.[dev,docs]'
	@$(PYTHON) -m sphinx -q -W -E --keep-going -c docs/site -d build/doctrees . build/docs
	@echo "build/docs/index.html"

# What is committed, as a release; `make release-check RELEASE=--help` has the parts.
release-check: setup
	@$(PYTHON) -m scripts.release_check $(RELEASE)

# Workflows, action, forms and citation, against schemas in the linters' own wheels: no network.
SCHEMA := .venv/bin/check-jsonschema -q --builtin-schema
lint-workflows: setup
	@$(SCHEMA) vendor.github-workflows .github/workflows/*.yml
	@$(SCHEMA) vendor.github-actions action.yml
	@$(SCHEMA) vendor.github-issue-forms .github/ISSUE_TEMPLATE/bug.yml .github/ISSUE_TEMPLATE/feature.yml
	@$(SCHEMA) vendor.github-issue-config .github/ISSUE_TEMPLATE/config.yml
	@$(SCHEMA) vendor.citation-file-format CITATION.cff
	@.venv/bin/zizmor --offline --quiet --pedantic .github/workflows action.yml

pictures: robots
	@$(PYTHON) scripts/pictures.py $(PICTURES)

comparison: setup
	@$(PYTHON) -m benchmarks.comparison.run $(COMPARISON)
	@$(PYTHON) -m benchmarks.comparison.page

simulate: setup
	@PYTHONPATH=simulation $(PYTHON) -m stepbus_simulation $(SIMULATE)

# The parts are campaign/test_runs.py and campaign/store.
PART := campaign
campaign: setup
	@$(PYTHON) -m pytest -vv $(PART) $(CAMPAIGN)

bench: setup
	@$(PYTHON) -m benchmarks.suite $(BENCH)

soak: setup
	@$(PYTHON) benchmarks/soak.py

examples: examples-c examples-rust

examples-c:
	@command -v gcc >/dev/null || { echo "skipped examples/controllers/c: gcc is not installed"; exit 0; }; \
		$(MAKE) --no-print-directory -C examples/controllers/c && \
		$(MAKE) --no-print-directory -C examples/thruster && \
		$(MAKE) --no-print-directory -C examples/fmu_drives PYTHON=$(abspath $(PYTHON))

examples-rust:
	@command -v cargo >/dev/null || { echo "skipped examples/controllers/rust: cargo is not installed"; exit 0; }; \
		nice cargo build --release --quiet --manifest-path examples/controllers/rust/Cargo.toml

robots: setup
	@$(PYTHON) -m pip install --disable-pip-version-check -q -c constraints.txt -e store

# Only their models: what the packages themselves depend on is not needed.
robots-page: robots
	@$(PYTHON) -m pip install --disable-pip-version-check -q --no-deps $$($(PYTHON) -m scripts.robots --packages)
	@$(PYTHON) -m scripts.robots

clean:
	rm -rf .venv .coverage* .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis build dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Each process of a run imports our code. With PYTHONDONTWRITEBYTECODE, as in many containers, it would
# also compile it each time, which took a quarter of the start-up time.
setup: EXTRAS := dev
setup-demo: EXTRAS := sim,report
setup setup-demo:
	@scripts/setup_venv.sh $(EXTRAS)
	@$(PYTHON) -m compileall -q api orchestrator participant scenarios schemas services store tools
