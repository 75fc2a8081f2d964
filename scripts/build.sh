#!/bin/sh
# SPDX-License-Identifier: MIT
# build.sh FOLDER [MESON OPTION...]: configures FOLDER once and builds it. In CI (CI is set) warnings are errors.
set -eu

folder=$1
shift
[ -n "${CI-}" ] && set -- "$@" -Dwerror=true
if [ ! -f "$folder/build.ninja" ]; then
    log=$(mktemp)
    if ! meson setup "$folder" "$@" >"$log" 2>&1; then
        tail -n 40 "$log" >&2
        rm -f "$log"
        rm -rf "$folder"
        exit 1
    fi
    rm -f "$log"
fi
ninja -C "$folder" ${JOBS:+-j"$JOBS"}
