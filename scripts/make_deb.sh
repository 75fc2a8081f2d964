#!/bin/sh
# SPDX-License-Identifier: MIT
# make_deb.sh: builds the Debian packages in build-deb/, from a copy of this folder, and checks them with lintian.
set -eu
cd "$(dirname "$0")/.."
version=$(sed -n "s/.*version: '\([0-9.]*\)'.*/\1/p" meson.build | head -n 1)
[ "$(dpkg-parsechangelog -S Version)" = "$version" ] || {
    echo "debian/changelog is of $(dpkg-parsechangelog -S Version), meson.build of $version" >&2
    exit 1
}
copy=build-deb/pellucid-$version
rm -rf build-deb
mkdir -p "$copy"
tar -c --exclude='./build*' --exclude=./.git --exclude=./out --exclude=__pycache__ --exclude=node_modules --exclude=./pellucid . |
    tar -x -C "$copy"
(cd "$copy" && dpkg-buildpackage -b -us -uc)
rm -rf "$copy"
lintian --allow-root --tag-display-limit 0 build-deb/*.changes
ls -l build-deb/*.deb
