# Two commands do everything from a fresh clone: `make demo` and `make test`. Both set up what they need, once.
.DEFAULT_GOAL := help
SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c

VENV   := .venv
PYTHON := $(abspath $(VENV))/bin/python
# Tests wait for bytes and for deadlines: two for each processor.
WORKERS := $(shell echo $$(( $$(nproc) * 2 )))
INTERFACE := $(wildcard $(addprefix python/src/wirebond/,engine_interface.py _engine.pyi link/engine_settings.py \
            protocol/model/fields.py protocol/model/frames.py protocol/payload_rules.py protocol/plan.py protocol/tables.py \
            ros2/mapping/packing.py))
NATIVE := CMakeLists.txt pyproject.toml $(INTERFACE) $(shell find core/include engine ports/posix python/native -name '*.[ch]pp')
PAGE   := console/index.html console/vite.config.ts console/svelte.config.js console/tsconfig.json $(shell find console/src -type f)
CPP_SOURCES = $(shell git ls-files '*.cpp' '*.hpp' '*.h' '*.c')

# ---- for users

.PHONY: help
help: ## show this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

.PHONY: setup
setup: build/setup.stamp ## virtual environment in .venv with the `wirebond` command in it

.PHONY: demo
demo: build/setup.stamp build/page.stamp ## a simulated rover on a tty, shown in the console until Ctrl-C (ARGS="--terminal": here)
	@exec $(VENV)/bin/wirebond demo $(ARGS)

.PHONY: page
page: build/page.stamp ## the console's page, into the Python package; needs Node 20.19 or newer

.PHONY: screenshots
screenshots: build/setup-test.stamp ## pictures of the console into docs/images (ARGS="--all FOLDER": of every view, to look at)
	@$(PYTHON) -m tests.console.screenshots $(ARGS)

.PHONY: test
test: build/setup-test.stamp lint ## all tests but the long ones, twenty minutes from a fresh clone
	@$(PYTHON) -m tests.runner --workers $(WORKERS)

.PHONY: test-paused
test-paused: build/setup-test.stamp ## the live tests while their processes are suspended at random, in about 25 minutes
	@$(PYTHON) -m tests.runner.pauses $(PYTHON) -m pytest -q -n $(WORKERS) -m "live and not long and not timed"

.PHONY: check
check: build/requirements-dev.stamp ## lint and the pure tests that your edits reach, in a minute (SINCE=COMMIT: since then)
	@$(PYTHON) -m tests.runner.check --since $(or $(SINCE),HEAD)

.PHONY: prove
prove: build/setup-test.stamp build/docs.stamp ## all tests, the long proofs too
	@$(PYTHON) -m tests.runner --workers $(WORKERS) --long

.PHONY: bench
bench: build/setup-bench.stamp ## tables of figures, and bench/latest.json (ONLY=name runs one)
	@$(PYTHON) -m bench $(if $(ONLY),--only $(ONLY),)

.PHONY: wheel
wheel: build/requirements.stamp build/page.stamp ## the Python package for this machine, in build/wheel
	@rm -rf build/wheel
	@$(PYTHON) -m pip wheel --quiet --disable-pip-version-check --no-build-isolation --no-deps \
	  --config-settings=build-dir=build/wheel-engine --wheel-dir build/wheel .
	@ls build/wheel/*.whl

.PHONY: wheels
wheels: build/setup.stamp build/requirements-dev.stamp build/page.stamp build/wasm.stamp ## Python packages for Linux, Windows and macOS, in build/wheels (ARGS="--only x86_64")
	@$(PYTHON) setup/wheels.py $(ARGS)

.PHONY: docs
docs: build/docs.stamp build/page-packages.stamp ## the documentation as a site, in build/site: open index.html there
	@build/docs/bin/python setup/docs_site.py
	@NO_MKDOCS_2_WARNING=1 build/docs/bin/mkdocs build --quiet --strict --site-dir "$(or $(SITE),build/site)"
	@echo "$(or $(SITE),build/site)/index.html"

.PHONY: release-check
release-check: wheels docs ## what a release consists of, in build/release, checked: half an hour (ARGS="--without wheels" after another run)
	@$(PYTHON) setup/release.py $(ARGS)

.PHONY: lint
lint: build/setup-test.stamp ## format, linters, strict types, dependency rules
	@$(VENV)/bin/ruff format --check --quiet python ros2 tests bench setup
	@$(VENV)/bin/ruff check --quiet python ros2 tests bench setup
	@clang-format-14 --dry-run --Werror $(CPP_SOURCES)
	@$(VENV)/bin/mypy
	@$(PYTHON) tests/architecture/dependency_rules.py
	@$(PYTHON) tests/architecture/waiting_rules.py
	@if [ -e build/page.stamp ]; then cd console && npm run --silent check; fi
	@echo "lint: format, linters, types and dependency rules hold"

.PHONY: format
format: build/setup-test.stamp ## write the format that lint checks
	@$(VENV)/bin/ruff format --quiet python ros2 tests bench setup
	@$(VENV)/bin/ruff check --quiet --fix python ros2 tests bench setup
	@clang-format-14 -i $(CPP_SOURCES)
	@if [ -e build/page.stamp ]; then cd console && npm run --silent format; fi

.PHONY: clean
clean: ## remove everything that was built
	@rm -rf build $(VENV) .mypy_cache .ruff_cache .pytest_cache

# ---- set-up; each stamp is made once, and again when what it depends on changed

$(VENV)/bin/python:
	@setup/system-packages.sh g++=g++ cmake=cmake python3=python3 ninja=ninja-build
	@python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "wirebond needs Python 3.11 or newer; python3 is $$(python3 -V)" >&2; exit 1; }
	@python3 -m venv $(VENV) || { rm -rf $(VENV); setup/system-packages.sh /nonexistent=python3-venv && python3 -m venv $(VENV); }

build/requirements.stamp: requirements.txt | $(VENV)/bin/python
	@echo "Installing Python packages into $(VENV)"
	@$(PYTHON) -m pip install --quiet --disable-pip-version-check -r requirements.txt
	@mkdir -p build && touch $@

# Only the tests, the lint and the benchmarks need these: `make demo` does not wait for them.
build/requirements-dev.stamp: requirements-dev.txt build/requirements.stamp
	@echo "Installing the developers' Python packages into $(VENV)"
	@$(PYTHON) -m pip install --quiet --disable-pip-version-check -r requirements-dev.txt
	@touch $@

build/setup.stamp: build/requirements.stamp $(NATIVE)
	@echo "Building the engine"
	@$(PYTHON) -m pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps --editable .
	@touch $@

# The site's generator has a Python environment of its own: nothing else needs it.
build/docs.stamp: requirements-docs.txt | $(VENV)/bin/python
	@echo "Installing the site's generator into build/docs"
	@mkdir -p build && $(PYTHON) -m venv build/docs
	@build/docs/bin/python -m pip install --quiet --disable-pip-version-check -r requirements-docs.txt
	@touch $@

# Without Node neither stamp is made, and nothing fails: setup/page.sh says what is missing.
build/page-packages.stamp: console/package.json console/package-lock.json console/.npmrc
	@mkdir -p build && if setup/page.sh packages; then touch $@; else [ $$? -eq 3 ]; fi

build/page.stamp: build/page-packages.stamp $(PAGE)
	@if [ -e build/page-packages.stamp ]; then setup/page.sh build && touch $@; fi

# The engine for browsers. The compiler builds its C++ library for it first, which takes a minute, once on a machine.
build/wasm.stamp: setup/wasm.sh $(shell find core/include engine -name '*.[chS]*') build/requirements-dev.stamp
	@echo "Compiling the engine to WebAssembly"
	@setup/wasm.sh $(PYTHON)
	@touch $@

# Wheels of ROS 2 exist for Linux and Python 3.11 alone. Without them the tests over rclpy are skipped.
build/rclpy.stamp: tests/ros2/rclpy.txt setup/rclpy.sh | build/requirements-dev.stamp
	@echo "Installing a ROS 2 for the tests into build/rclpy"
	@setup/rclpy.sh $(PYTHON) build/rclpy || \
	  echo "tests/ros2/rclpy.txt cannot be installed: what runs over rclpy is left out" >&2
	@touch $@

build/setup-bench.stamp: build/setup-test.stamp bench/requirements.txt
	@$(PYTHON) -m pip install --quiet --disable-pip-version-check -r bench/requirements.txt || \
	  echo "bench/requirements.txt cannot be installed: there will be no plots" >&2
	@touch $@

build/freertos.stamp: setup/freertos/Cargo.toml setup/freertos/Cargo.lock
	@setup/system-packages.sh cargo=cargo-web
	@echo "Fetching the FreeRTOS kernel into build/freertos"
	@cargo vendor --quiet --locked --versioned-dirs --manifest-path setup/freertos/Cargo.toml build/freertos >/dev/null
	@touch $@

build/setup-test.stamp: build/setup.stamp build/requirements-dev.stamp build/freertos.stamp build/page.stamp build/rclpy.stamp \
  build/wasm.stamp
	@setup/system-packages.sh clang++-14=clang-14 clang-format-14=clang-format-14 arm-none-eabi-g++=gcc-arm-none-eabi \
	  /usr/lib/arm-none-eabi/include/c++=libstdc++-arm-none-eabi-newlib /usr/include/doctest/doctest.h=doctest-dev \
	  /usr/include/relacy/relacy.hpp=relacy-dev \
	  /usr/lib/clang/14/lib/linux/libclang_rt.asan-x86_64.a=libclang-rt-14-dev llvm-cov-14=llvm-14 valgrind=valgrind \
	  aarch64-linux-gnu-g++=g++-aarch64-linux-gnu qemu-aarch64=qemu-user \
	  qemu-system-arm=qemu-system-arm setpriv=util-linux /usr/sbin/ser2net=ser2net socat=socat \
	  chromium=chromium /usr/share/fonts/opentype/noto/NotoSansCJK-Regular.ttc=fonts-noto-cjk
	@touch $@
