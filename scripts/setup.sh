#!/bin/sh
# SPDX-License-Identifier: MIT
# Installs what is missing of the packages in scripts/packages.txt (and packages-ci.txt with --ci), or says how. Silent when nothing is.
# SETUP=no in the environment skips it.
set -eu

here=$(dirname "$0")
lists=$here/packages.txt
[ "${1-}" = --ci ] && lists="$lists $here/packages-ci.txt"
[ "${SETUP-yes}" = no ] && exit 0

# shellcheck disable=SC2086 # two names of files
wanted=$(sed 's/#.*//' $lists | tr -s ' \n' '  ')

if ! command -v dpkg-query >/dev/null 2>&1; then
    command -v meson >/dev/null 2>&1 && command -v ninja >/dev/null 2>&1 && exit 0
    echo "This is no Debian system. Install what these Debian packages hold, then try again:" >&2
    echo " $wanted" >&2
    exit 1
fi

# shellcheck disable=SC2086 # a list of names
present=" $(dpkg-query -W -f='${db:Status-Status}:${Package} ' $wanted 2>/dev/null || true)"
missing=
for package in $wanted; do
    case $present in
    *" installed:$package "*) ;;
    *) missing="$missing $package" ;;
    esac
done
[ -n "$missing" ] || exit 0

if [ "$(id -u)" != 0 ]; then
    echo "Packages are missing. Install them with this command, then try again:" >&2
    echo "  sudo apt-get install --no-install-recommends$missing" >&2
    exit 1
fi

echo "installing:$missing"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
export DEBIAN_FRONTEND=noninteractive
# shellcheck disable=SC2086 # a list of names
if ! apt-get update >"$log" 2>&1 || ! apt-get install -y --no-install-recommends $missing >>"$log" 2>&1 </dev/null; then
    tail -n 30 "$log" >&2
    echo "The packages could not be installed." >&2
    exit 1
fi
