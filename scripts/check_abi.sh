#!/bin/sh
# SPDX-License-Identifier: MIT
# check_abi.sh [REVISION]: whether programs that were linked to the library of REVISION (the last tag) run with this one: builds both and
# compares them by abidiff. What was removed or changed is an error while the version promises that it stays (docs/adr/0011: before 1.0,
# while the minor number is the same); what was added is reported.
set -eu

cd "$(dirname "$0")/.."
old=${1-$(git describe --tags --abbrev=0 2>/dev/null || true)}
if [ -z "$old" ]; then
    echo "there is no tag: nothing to compare the library with"
    exit 0
fi
command -v abidiff >/dev/null || {
    echo "abidiff is not installed (abigail-tools)" >&2
    exit 1
}

work=$(mktemp -d)
trap 'git worktree remove --force "$work/old" 2>/dev/null || true; rm -rf "$work"' EXIT
git worktree add -q --detach "$work/old" "$old"

version_of() # SOURCE
{
    sed -n "s/^ *version: '\([0-9.]*\)'.*/\1/p" "$1/meson.build" | head -1
}
library() # SOURCE BUILD
{
    meson setup "$2" "$1" --buildtype=debug -Dtests=false -Dsimd=base >"$work/log" 2>&1 &&
        ninja -C "$2" "src/libpellucid.so.$(version_of "$1")" >>"$work/log" 2>&1 || { tail -20 "$work/log" >&2; exit 1; }
}
promise() # SOURCE: the part of the version that compatibility goes by
{
    version_of "$1" | awk -F. '{ print $1 == 0 ? $1 "." $2 : $1 }'
}
library "$work/old" "$work/build-old"
library . "$work/build-new"

status=0
abidiff --no-show-locs --headers-dir1 "$work/old/include" --headers-dir2 include "$work/build-old/src/libpellucid.so" \
    "$work/build-new/src/libpellucid.so" >"$work/report" || status=$?
cat "$work/report"
if [ $((status & 3)) != 0 ]; then
    echo "abidiff failed" >&2
    exit 1
fi
# Functions and variables that were removed or have another type break programs; new ones do not.
broken=$(sed -n 's/^[FV][a-z]* changes summary: \([0-9]*\) Removed, \([0-9]*\) Changed.*/\1 \2/p' "$work/report" |
    awk '{ n += $1 + $2 } END { print n + 0 }')
if [ "$broken" != 0 ] || [ $((status & 8)) != 0 ]; then
    if [ "$(promise "$work/old")" = "$(promise .)" ]; then
        echo "the library breaks programs that were linked to $old, and its version does not say so" >&2
        exit 1
    fi
    echo "programs that were linked to $old must be built again, as the version says"
fi
