#!/bin/sh
# SPDX-License-Identifier: MIT
# test_packages.sh [ROOT]: as root, installs the packages of build-deb/ into a bare Debian in the folder ROOT (build-deb/root, made with
# debootstrap where it is not there), runs the programs of debian/tests against them, purges them, and looks for traces.
set -eu
cd "$(dirname "$0")/.."
root=${1-build-deb/root}

if [ ! -d "$root/etc" ]; then
    # shellcheck source=/dev/null
    debootstrap --variant=minbase "$(. /etc/os-release && echo "$VERSION_CODENAME")" "$root"
fi
inside()
{
    chroot "$root" env DEBIAN_FRONTEND=noninteractive LC_ALL=C.UTF-8 "$@"
}
rm -rf "$root/packages"
mkdir -p "$root/packages/debian"
cp build-deb/*.deb "$root/packages"
rm -f "$root"/packages/*-dbgsym_*
cp -r debian/tests "$root/packages/debian"
trap 'rm -rf "$root/packages"' EXIT

inside apt-get update -q
inside sh -c 'apt-get install -y -q --no-install-recommends /packages/*.deb gcc libc6-dev pkg-config'
for test in c-program program; do
    echo "== debian/tests/$test"
    inside sh -c "cd /packages && sh debian/tests/$test"
done
echo "== debian/tests/program.py"
inside sh -c 'cd /packages && python3 debian/tests/program.py'
inside apt-get purge -y -q libpellucid0 libpellucid-dev pellucid python3-pellucid pellucid-doc
left=$(find "$root/usr" "$root/etc" "$root/var/lib/dpkg/info" -iname '*pellucid*' 2>/dev/null)
if [ -n "$left" ]; then
    echo "left behind after the purge:" >&2
    echo "$left" >&2
    exit 1
fi
echo "installed, used and purged without a trace"
