# make demo: install into .venv and print the style benchmark.   make test: the tests.   make check: what CI checks besides.
SHELL := /bin/sh
ROOT := $(dir $(abspath $(lastword $(MAKEFILE_LIST))))
VENV := $(ROOT).venv
BIN := $(VENV)/bin
PYTHON ?= python3
export MPLBACKEND := Agg

.PHONY: demo test test-clients test-page test-portable soak coverage mutants check site results bench clean

INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c $(ROOT)constraints.txt

$(VENV)/.installed: $(ROOT)pyproject.toml $(ROOT)constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
	  { echo "motion-gym needs Python 3.10 or newer, and $(PYTHON) is older: make PYTHON=python3.12 ..."; exit 1; }
	@echo 'Installing into $(VENV), with PyTorch: a few minutes.'
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) -e "$(ROOT)[torch]"
	@touch $@

$(VENV)/.ready: $(VENV)/.installed
	$(INSTALL) -e "$(ROOT)[dev]"
	@touch $@

demo: $(VENV)/.installed
	$(BIN)/motion-gym run style
	$(BIN)/motion-gym report --out $(ROOT)motion-gym-results.html
	@echo 'Open motion-gym-results.html in a browser: all results, and a player of scenes.'
	@echo 'Next: write a predictor, as examples/own_predictor.py. From the folder examples:'
	@echo '  . ../.venv/bin/activate; motion-gym score own_predictor:Turning --domain orca:d=0.6'

# Two tests side by side, each with one thread of torch: more would wait for each other.
test: $(VENV)/.ready
	cd $(ROOT) && OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal $(ARGS)

# Learning libraries and Ray, in environments that also see the packages of .venv: RLlib needs an older Gymnasium.
CLIENTS := $(VENV)-clients
$(CLIENTS)-%/.ready: $(ROOT)constraints-clients-%.txt $(VENV)/.ready
	$(BIN)/python -m venv $(@D)
	$(BIN)/python -c 'import sysconfig as s; print("import site; site.addsitedir(%r)" % s.get_path("purelib"))' \
	  > "$$($(@D)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/venv.pth"
	$(@D)/bin/python -m pip install --quiet --disable-pip-version-check -r $<
	@touch $@

test-clients: $(CLIENTS)-rl/.ready $(CLIENTS)-rllib/.ready $(CLIENTS)-ray/.ready
	cd $(ROOT) && for name in rl rllib ray; do \
	    OMP_NUM_THREADS=1 $(CLIENTS)-$$name/bin/python -m pytest tests/clients/$$name $(ARGS) || exit 1; \
	  done

# The results page, in a browser without a window; Chromium must be installed.
$(VENV)/.page: $(VENV)/.ready
	$(INSTALL) -e "$(ROOT)[page]"
	@touch $@

test-page: $(VENV)/.page
	cd $(ROOT) && OMP_NUM_THREADS=1 $(BIN)/python -m pytest tests/page $(ARGS)

# Kills, full disks, damaged and hostile files, long streams; writes a table into docs/reliability.md. The part about disks
# needs root. An hour on two quiet cores; ARGS="--tries 2" tries less.
soak: $(VENV)/.ready
	cd $(ROOT) && OMP_NUM_THREADS=1 $(BIN)/python -m pytest tests/soak --page docs/reliability.md $(ARGS)

$(VENV)/.audit: $(VENV)/.ready
	$(INSTALL) mutmut pytest-cov
	@touch $@

# Line coverage of the tests by package, written into docs/reliability.md.
coverage: $(VENV)/.audit
	cd $(ROOT) && OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --cov=motion_gym --cov=envs --cov=predictors \
	  --cov-report=json $(ARGS)
	cd $(ROOT) && $(BIN)/python -m tests.soak.coverage_table coverage.json docs/reliability.md

# Mutants of the metrics and clocks, in a copy of the sources; hours. docs/reliability.md lists the survivors.
MUTANTS := $(VENV)-mutants
mutants: $(VENV)/.audit
	rm -rf $(MUTANTS) && mkdir $(MUTANTS)
	cd $(ROOT) && cp -rL motion_gym tests pyproject.toml README.md LICENSE $(MUTANTS)
	rm -rf $(MUTANTS)/motion_gym/weights/* $(MUTANTS)/motion_gym/results/*
	cd $(MUTANTS) && OMP_NUM_THREADS=1 $(BIN)/mutmut run --max-children 2
	cd $(ROOT) && $(BIN)/python -m tests.soak.mutants page $(MUTANTS)/mutants docs/reliability.md

# The documentation, in site/; a broken link fails (not with --quiet).
$(VENV)/.site: $(VENV)/.installed
	$(INSTALL) -e "$(ROOT)[site]"
	@touch $@

site: $(VENV)/.site
	cd $(ROOT) && NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# The numerical tests under other code paths of the same libraries, as other processors take them.
NUMERICAL := tests/metrics tests/data tests/envs tests/stepping tests/scoring tests/online tests/predictors tests/training
test-portable: $(VENV)/.ready
	cd $(ROOT) && for threads in 1 2; do \
	    ATEN_CPU_CAPABILITY=default OPENBLAS_CORETYPE=Haswell NUMBA_CPU_NAME=generic NUMBA_CACHE_DIR=$(VENV)/numba-generic \
	      OMP_NUM_THREADS=$$threads $(BIN)/python -m pytest -n $$((3 - threads)) $(NUMERICAL) $(ARGS) || exit 1; \
	  done

check: $(VENV)/.ready
	cd $(ROOT) && $(BIN)/ruff check .
	cd $(ROOT) && $(BIN)/ruff format --check .
	cd $(ROOT) && $(BIN)/mypy
	cd $(ROOT) && $(BIN)/python -m pytest --doctest-modules motion_gym envs predictors -p no:cacheprovider
	cd $(ROOT) && $(BIN)/python .ci/check_wheel.py

# `published` is left out: its external programs need checkouts, see examples/published/README.md.
# The stored runs, the tables and the figures of all benchmarks, from scratch: about four hours on two cores. `sdd` and
# `sdd_style` need the weights of `heatmap`: motion-gym weights add --from DIR.
results: $(VENV)/.ready
	cd $(ROOT) && for name in baselines sdd sdd_style spurious places elsewhere original style crowd factors transfer refinement pretraining online \
	    vehicles vehicles_spurious planning; do \
	    $(BIN)/motion-gym run $$name --fresh --pack --out motion_gym/results || exit 1; \
	  done
	cd $(ROOT) && for name in style places; do $(BIN)/motion-gym run $$name --into README.md || exit 1; done
	cd $(ROOT) && $(BIN)/motion-gym claims --out docs/claims.md
	cd $(ROOT) && $(BIN)/python docs/pitfalls.py
	cd $(ROOT) && $(BIN)/motion-gym show orca:agents=10,d=0.5,scenes=50 --scene 3 --predictor constant_velocity \
	  --predictor modular_stgat --out docs/scene.svg

# Measures, and writes bench/RESULTS.md; about 17 minutes on a quiet machine.
bench: $(CLIENTS)-ray/.ready
	cd $(ROOT) && BIN=$(CLIENTS)-ray/bin sh bench/run

clean:
	rm -rf $(VENV) $(CLIENTS)-* $(MUTANTS) $(ROOT)build $(ROOT)dist $(ROOT)site $(ROOT)*.egg-info
