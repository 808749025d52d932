# The two commands a new user needs:  make demo   and   make test.
# Everything runs from .venv, which sets itself up with what requirements/ names: versions and hashes.
# Where packages come with other hashes (piwheels on a Raspberry Pi):  make demo HASHES=no

# A Python with pip, the system's before that of an environment which happens to be activated.
# The name of a folder may have any characters: it is a word of the shell, and no part of a pattern.
HERE := '$(subst ','\'',$(CURDIR))'
PYTHON ?= $(shell without() { IFS=:; kept=; for one in $$2; do \
	[ "$$one" = "$$1" ] || kept="$$kept$${kept:+:}$$one"; done; unset IFS; printf %s "$$kept"; }; here=$(HERE)/.venv; \
	all=$$(without "$$here/bin" "$$PATH"); system=$$(without "$${VIRTUAL_ENV:-$$here}/bin" "$$all"); \
	for needed in 'import pip, sys' 'import sys'; do for PATH in "$$system" "$$all"; do \
	for p in python3 python3.13 python3.12 python3.11; do command -v $$p >/dev/null 2>&1 && \
	$$p -c "$$needed; sys.exit(sys.version_info < (3, 11))" 2>/dev/null && command -v $$p && exit; done; done; done)
VENV := .venv
BIN := $(VENV)/bin
ARGS ?=
ENGINE ?= uml
# One distribution's own tests: make test PACKAGE=xrce (or agent, msbot, school, bridges, web)
PACKAGE ?=
# Protocols and rules: what a change breaks first, in about a minute.
QUICK := packages/msbot-xrce/tests $(addprefix packages/msbot-agent/tests/,conformance agent link/can/protocol idl) \
	$(addprefix packages/msbot/tests/,config part pnp)
HASHES ?= yes

# The tests start hundreds of processes: where Python may not keep what it has compiled, each compiles all it imports.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test tests quick check format vm bench wheel docs release deb image image-test screenshots assets board requirements clean help

help:
	@echo 'make demo    set up and run a robot of ten parts, all simulated; ARGS="--robot thesis --link fd" passes options on'
	@echo 'make test    set up, check style, types and layering, run all tests; PACKAGE=xrce: those of one distribution'
	@echo 'make tests   the tests only; ARGS="-p tests.cost" shows what each costs'
	@echo 'make quick   the tests of protocols and rules that start no process and no browser: about a minute'
	@echo 'make check   style, types, layering only'
	@echo 'make vm      fetch a virtual machine for the tests on a real CAN bus (42 MB); ENGINE=qemu: with CAN controllers'
	@echo 'make bench   print the tables of figures'
	@echo 'make screenshots   pictures of every page into build/screenshots, the best into docs/pictures (needs chromium)'
	@echo 'make board   compile the package for boards with MicroPython into build/board'
	@echo 'make assets  fetch the files of others that are carried along again (needs npm), and compare them'
	@echo 'make wheel   make packages for other computers: dist/msbot*.whl'
	@echo 'make deb     make a package for this release of Debian in build/debian'
	@echo 'make image   make the image of an SD card for the Raspberry Pi, build/image/msbot-pi.img (root, Debian 12)'
	@echo 'make image-test   start it in a virtual computer: cuts of the power, set-up, updates; ARGS="--only cuts --cuts 3"'
	@echo 'make requirements   write requirements/ anew; ARGS=--upgrade takes the newest versions'
	@echo 'make docs    build the documentation site, with the API of the packages, into site/ (needs npm, once)'
	@echo 'make release make a release of what is committed into build/release, and try it; ARGS="--only 3.12"'

$(BIN)/python:
	@test -n '$(PYTHON)' || { echo 'MsBOT needs Python 3.11 or newer; none was found. Install it, or call: make PYTHON=/path/to/python3' >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo 'MsBOT needs Python 3.11 or newer, and $(PYTHON) is older or does not run. Call: make PYTHON=/path/to/python3' >&2; exit 1; }
	@$(PYTHON) -m pip --version >/dev/null 2>&1 || { echo 'MsBOT needs pip, and $(PYTHON) has none. On Debian, Ubuntu, Raspberry Pi OS: sudo apt install python3-pip' >&2; exit 1; }
	@$(PYTHON) -m venv --without-pip $(VENV)

INSTALL = $(PYTHON) tools/set_up.py $(if $(filter no,$(HASHES)),--no-hashes) $(BIN)/python

PROJECTS = $(wildcard packages/*/pyproject.toml)

$(VENV)/.run: $(PROJECTS) requirements/run.txt | $(BIN)/python
	@echo 'Setting up MsBOT in $(VENV), once: one to three minutes.' >&2
	@$(INSTALL) requirements/run.txt
	@touch $@

$(VENV)/.dev: $(PROJECTS) requirements/dev.txt | $(BIN)/python
	@echo 'Setting up MsBOT for development in $(VENV), once: about two minutes.' >&2
	@$(INSTALL) requirements/dev.txt
	@touch $@ $(VENV)/.run

$(VENV)/.docs: $(PROJECTS) requirements/docs.txt | $(BIN)/python
	@$(INSTALL) requirements/docs.txt
	@touch $@

demo: $(VENV)/.run
	@$(BIN)/msbot demo $(ARGS)

check: $(VENV)/.dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(PYTHON) -m pip --python $(BIN)/python check

test: $(if $(PACKAGE),,check) tests

# A file of tests stays on one worker, which makes its fixtures once; the files that take longest come first, and two
# workers have no browser (tests/taking_turns.py).
tests: $(VENV)/.dev
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder $(if $(PACKAGE),packages/$(patsubst msbot-msbot,msbot,msbot-$(PACKAGE))/tests) $(ARGS)

quick: $(VENV)/.dev
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder -p tests.quick $(QUICK) $(ARGS)

format: $(VENV)/.dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

vm:
	tools/run-in-vm.sh -v --setup $(ENGINE)

bench: $(VENV)/.dev
	$(BIN)/python -m bench.can
	$(BIN)/python -m bench.live
	$(BIN)/python -m bench.path
	$(BIN)/python -m bench.can_path
	$(BIN)/python -m bench.library
	$(BIN)/python -m bench.messages
	$(BIN)/python -m bench.matching
	$(BIN)/python -m bench.spare
	$(BIN)/python -m bench.many_parts --kill
	$(BIN)/python -m bench.stop
	$(BIN)/python -m bench.micropython
	$(BIN)/python -m bench.page
	$(BIN)/python -m bench.page_parts
	$(BIN)/python -m bench.agent --write
	$(BIN)/python -m bench.dds --write
	$(BIN)/python -m bench.scale --write
	$(BIN)/python -m bench.growth --write
	$(BIN)/python -m bench.startup --write
	$(BIN)/python -m bench.takeover --write
	$(BIN)/python -m bench.matrix --write
	$(BIN)/python -m bench.ways --write

wheel: $(VENV)/.run
	@rm -rf dist && mkdir dist
	@$(BIN)/python tools/man_pages.py
	@$(PYTHON) -m pip --python $(BIN)/python wheel --quiet --disable-pip-version-check --no-deps --no-build-isolation --wheel-dir dist $(dir $(PROJECTS))
	@ls dist/*.whl
	@echo "Elsewhere: pip install '$$(ls dist/msbot-*.whl)[all]' dist/msbot_*.whl"

docs: $(VENV)/.docs
	PYTHONPATH=. $(BIN)/python tools/can_picture.py docs/explain/can_frame.svg
	$(BIN)/python tools/docs_site.py site

deb: $(VENV)/.dev
	$(BIN)/python tools/debian_package.py build/debian $(ARGS)

image: $(VENV)/.dev
	$(BIN)/python -m tools.card_image build/image $(ARGS)

image-test: $(VENV)/.dev
	$(BIN)/python -m tools.card_image.trial build/image/msbot-pi.img --package "$$(ls -t build/image/kept/msbot_*_arm64.deb | head -1)" $(ARGS)

release: $(VENV)/.dev $(VENV)/.docs
	$(BIN)/python -m tools.release build/release $(ARGS)

screenshots: $(VENV)/.dev
	$(BIN)/python tools/screenshots.py build/screenshots --keep docs/pictures

board: $(VENV)/.dev
	$(BIN)/python tools/board_package.py build/board

assets:
	$(PYTHON) tools/assets.py $(ARGS)

requirements: $(VENV)/.dev
	$(BIN)/python tools/requirements.py $(BIN)/uv $(ARGS)

clean:
	rm -rf $(VENV) site dist build .mypy_cache .ruff_cache .pytest_cache .hypothesis
