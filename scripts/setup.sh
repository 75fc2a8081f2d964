#!/bin/sh
# SPDX-License-Identifier: MIT
# Installs what is missing of the packages in scripts/packages.txt (with --ci also of packages-ci.txt, and the modules of tests/browser;
# with --deb of packages-deb.txt), or says how. Silent when nothing is.
# SETUP=no in the environment skips it.
set -eu

here=$(dirname "$0")
lists=$here/packages.txt
more=${1-}
[ -n "$more" ] && lists="$lists $here/packages-${more#--}.txt"
[ "${SETUP-yes}" = no ] && exit 0

# shellcheck disable=SC2086 # two names of files
wanted=$(sed 's/#.*//' $lists | tr -s ' \n' '  ')

# Without them the test of the report in a browser is skipped, which the tests' summary says.
modules()
{
    [ "$more" = --ci ] && command -v npm >/dev/null 2>&1 || return 0
    [ "$here/../tests/browser/node_modules/.package-lock.json" -nt "$here/../tests/browser/package-lock.json" ] && return 0
    echo "installing: the modules of tests/browser"
    npm ci --prefix "$here/../tests/browser" --ignore-scripts --no-audit --no-fund >/dev/null 2>&1 ||
        echo "The modules of tests/browser could not be installed: the test of the report in a browser is skipped." >&2
}

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
    *" installed:$package "*) continue ;;
    esac
    case $package in # these have other sources, too
    nodejs) command -v node >/dev/null 2>&1 && continue ;;
    npm | chromium) command -v "$package" >/dev/null 2>&1 && continue ;;
    esac
    missing="$missing $package"
done
if [ -z "$missing" ]; then
    modules
    exit 0
fi

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
modules
