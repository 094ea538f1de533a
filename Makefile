# All targets need Python >= 3.10 and make; they set up everything else in .venv.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STRIP  := $(BIN)/nbstripout --keep-id --extra-keys metadata.language_info
# Small matrices gain nothing from BLAS threads, and two test processes share the cores.
export OPENBLAS_NUM_THREADS := 1

.PHONY: install demo notebook strip check test floors newest lint bench realtime docs picture clean

$(VENV)/installed: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit("pinadapt needs Python >= 3.10; try make PYTHON=python3.12") if sys.version_info < (3, 10) else None'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet -e .
	touch $@

$(VENV)/dev: $(VENV)/installed
	$(BIN)/python -m pip install --quiet -e '.[dev]'
	touch $@

install: $(VENV)/installed

demo: $(VENV)/installed
	$(BIN)/pinadapt demo

$(VENV)/notebooks: $(VENV)/installed
	$(BIN)/python -m pip install --quiet -e '.[notebooks]'
	touch $@

notebook: $(VENV)/notebooks
	$(BIN)/jupyter-lab --notebook-dir notebooks

strip: $(VENV)/dev
	$(STRIP) notebooks/*.ipynb

check: lint
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not slow and not notebooks"

test: lint
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not notebooks"

# The fast tests with the lowest versions that pyproject.toml allows, or the newest: make floors
# PYTHON=python3.13. An environment of its own each time; ready-made packages only, as old sources
# need old compilers.
floors: RESOLUTION := lowest-direct
newest: RESOLUTION := highest
floors newest: FOLDER := build/$(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])')
floors newest:
	$(PYTHON) -m venv --clear $(FOLDER)-$@
	$(FOLDER)-$@/bin/python -m pip install --quiet 'uv>=0.4'
	$(FOLDER)-$@/bin/uv pip install --quiet --python $(FOLDER)-$@/bin/python --no-build \
		--resolution $(RESOLUTION) -r pyproject.toml --extra dev
	$(FOLDER)-$@/bin/uv pip install --quiet --python $(FOLDER)-$@/bin/python --no-deps -e .
	$(FOLDER)-$@/bin/uv pip list --python $(FOLDER)-$@/bin/python
	PATH="$(CURDIR)/$(FOLDER)-$@/bin:$$PATH" $(FOLDER)-$@/bin/python -m pytest -n 2 --dist loadfile \
		-m "not slow and not notebooks"

lint: $(VENV)/dev
	$(BIN)/ruff format --check src tests benchmarks notebooks docs
	$(BIN)/ruff check src tests benchmarks notebooks docs
	$(BIN)/mypy
	$(STRIP) --verify notebooks/*.ipynb

bench: $(VENV)/dev
	$(BIN)/python -m benchmarks.control_step

realtime: $(VENV)/installed
	$(BIN)/python -m benchmarks.realtime
	$(BIN)/python -m benchmarks.realtime --load

# A table of the documentation, measured again and written into its page: make tracker.table
%.table: $(VENV)/dev
	$(BIN)/python -m benchmarks.tables $* --again

$(VENV)/docs: $(VENV)/dev
	$(BIN)/python -m pip install --quiet -e '.[docs]'
	touch $@

docs: $(VENV)/docs
	$(BIN)/python -m pytest tests/docs/test_notebooks.py
	$(BIN)/python docs/gallery.py
	$(BIN)/sphinx-build -W --keep-going --fresh-env docs build/site

picture: $(VENV)/dev
	$(BIN)/python docs/moving_picture.py

clean:
	rm -rf $(VENV) build dist out docs/api docs/gallery
