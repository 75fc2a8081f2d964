#!/bin/sh
# SPDX-License-Identifier: MIT
# link_program.sh FOLDER: makes ./pellucid lead to the program that was built in FOLDER.
set -eu

program=$(find "$1" -name pellucid -type f -perm -u+x | head -n 1)
if [ -z "$program" ]; then
    echo "no program was built in $1" >&2
    exit 1
fi
ln -sf "$program" pellucid
