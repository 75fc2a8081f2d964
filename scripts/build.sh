#!/bin/sh
# SPDX-License-Identifier: MIT
# build.sh FOLDER [MESON OPTION...]: configures FOLDER once and builds it; build folders share the example meshes, in build-assets. In CI
# (CI is set) warnings are errors. TARGETS: what to build
# (all), names of Ninja's, or suite:NAME[,-OTHER], what the tests of that suite run (without those of another).
set -eu

folder=$1
shift
[ -n "${CI-}" ] && set -- "$@" -Dwerror=true
if [ ! -f "$folder/build.ninja" ]; then
    log=$(mktemp)
    if ! meson setup "$folder" -Dassets="$PWD/build-assets" "$@" >"$log" 2>&1; then
        tail -n 40 "$log" >&2
        rm -f "$log"
        rm -rf "$folder"
        exit 1
    fi
    rm -f "$log"
fi
targets=${TARGETS-}
case $targets in suite:*) targets=$("${0%/*}/suite_targets.py" "$folder" "${targets#suite:}") ;; esac
# shellcheck disable=SC2086 # several words
ninja -C "$folder" ${JOBS:+-j"$JOBS"} $targets
