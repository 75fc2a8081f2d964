# SPDX-License-Identifier: MIT
# What people type. The build itself is Meson's: meson.build.
#
# SETUP=no     don't look for missing packages
# BUILD=DIR    where to build (build)
# PREFIX=DIR   where `make install` puts things (/usr/local), below DESTDIR
# JOBS=N       compile N files at a time

BUILD ?= build
PREFIX ?= /usr/local
FUZZ_SECONDS ?= 60
SOAK_HOURS ?= 2
export SETUP JOBS

# The sanitizers run with clang: with them gcc 12 needs minutes for one kernel file and warns of what the instrumentation adds. Kernels are
# built for one level: they are plain C, so another level shows the sanitizers nothing new, and takes as long again to build. Vulkan
# drivers are loaded for tests that are about a device alone (tests/meson.build): Mesa's for the CPU leaks.
watched = -Dsimd=base -Db_lundef=false
sanitized = ASAN_OPTIONS=halt_on_error=1:detect_stack_use_after_return=1:strict_string_checks=1:allocator_may_return_null=1 \
            UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1 \
            TSAN_OPTIONS=halt_on_error=1:second_deadlock_stack=1:suppressions=$(CURDIR)/tests/tsan.supp

.PHONY: help shaders demo build test test-asan test-tsan fuzz-short \
        soak test-mpi check-clang install uninstall deb test-deb check-abi docs clean

help: ## this list
	@sed -n 's/^\([a-z-]*\):.*## /\1|/p' $(firstword $(MAKEFILE_LIST)) | awk -F'|' '{ printf "make %-12s %s\n", $$1, $$2 }'

demo: build ## sets up, builds, renders the example scenes and says where the images are
	@scripts/demo.sh "$(BUILD)"

build: ## sets up and builds ./pellucid
	@scripts/setup.sh
	@scripts/build.sh "$(BUILD)" --prefix "$(PREFIX)"
	@scripts/link_program.sh "$(BUILD)"

test: build ## sets up, builds, runs every test
	@scripts/run_tests.py "$(BUILD)" test

# Not the suite "accuracy" under the sanitizers: numbers of long renderings by code that other tests run through, too.
test-asan: ## tests of code under the address and undefined-behaviour sanitizers
	@scripts/setup.sh --ci
	@CC=clang scripts/build.sh build-asan --buildtype=debugoptimized -Db_sanitize=address,undefined $(watched) -Dc_args=-gline-tables-only
	@$(sanitized) scripts/run_tests.py build-asan test-asan --timeout-multiplier 6 $(addprefix --no-suite ,docs style browser accuracy)

test-tsan: ## the tests that start threads, under the thread sanitizer
	@scripts/setup.sh --ci
	@CC=clang TARGETS=suite:threads,-accuracy scripts/build.sh build-tsan --buildtype=debugoptimized -Db_sanitize=thread $(watched) \
	    -Dc_args=-gline-tables-only
	@$(sanitized) scripts/run_tests.py build-tsan test-tsan --timeout-multiplier 6 --suite threads --no-suite accuracy

shaders: ## the methods' compute shaders as SPIR-V, HLSL and MSL, in build/shaders (needs spirv-cross)
	@scripts/export_shaders.py "$(BUILD)/shaders"

test-mpi: ## pellucid-mpi under mpirun: the same bits on any number of ranks, killed and resumed
	@scripts/setup.sh --ci
	@scripts/build.sh build-mpi -Dmpi=enabled
	@scripts/run_tests.py build-mpi test-mpi --suite mpi

fuzz-short: ## each fuzz target for some seconds (FUZZ_SECONDS=60 in all)
	@scripts/setup.sh --ci
	@CC=clang TARGETS=fuzzers scripts/build.sh build-fuzz --buildtype=debug -Doptimization=1 -Db_sanitize=address,undefined $(watched) \
	    -Dfuzz=true -Dtests=false '-Dc_args=-gline-tables-only -fsanitize=fuzzer-no-link'
	@scripts/run_fuzz.py build-fuzz $(FUZZ_SECONDS)

# SOAK_SEED=N repeats a run. A day: make soak SOAK_HOURS=24
soak: build ## hours of damaged files, random scenes, too little memory and kills (SOAK_HOURS=2)
	@scripts/soak.py "$(BUILD)/src/cli/pellucid" --hours $(SOAK_HOURS) $(if $(SOAK_SEED),--seed $(SOAK_SEED))

# Without assertions, as a release is; the build under the sanitizers has them. Clang's warnings do not depend on the optimisation level.
check-clang: ## builds everything with clang, warnings are errors
	@scripts/setup.sh --ci
	@CC=clang scripts/build.sh build-clang --buildtype=plain -Db_ndebug=true -Dsimd=base -Dwerror=true

install: ## builds, installs program, library and headers
	@if [ -f "$(BUILD)/build.ninja" ]; then meson configure "$(BUILD)" --prefix "$(PREFIX)"; fi
	@$(MAKE) --no-print-directory build
	@meson install -C "$(BUILD)" --no-rebuild $(if $(DESTDIR),--destdir "$(DESTDIR)")
	@scripts/installed.py remember "$(BUILD)/meson-logs/install-log.txt" "$(BUILD)/installed.txt"

uninstall: ## removes all that `make install` has put anywhere from this build
	@scripts/installed.py remove "$(BUILD)/installed.txt"

deb: ## Debian packages in build-deb/, checked by lintian
	@scripts/setup.sh --deb
	@scripts/make_deb.sh

test-deb: deb ## installs the packages into a bare Debian (as root, with debootstrap), uses and purges them
	@scripts/test_packages.sh

check-abi: ## compares the library with that of the last tag, by abidiff
	@scripts/setup.sh --ci
	@scripts/check_abi.sh

docs: ## the documentation as pages for a browser, in build-docs/
	@scripts/setup.sh --docs
	@scripts/make_docs.sh build-docs

clean: ## removes all that was built
	@rm -rf build build-asan build-tsan build-fuzz build-clang build-deb build-docs build-mpi build-assets pellucid
