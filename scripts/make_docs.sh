#!/bin/sh
# SPDX-License-Identifier: MIT
# make_docs.sh FOLDER: docs/site/make_site.py, by a Python that has Markdown.
set -eu

cd "$(dirname "$0")/.."
for python in python3 /usr/bin/python3; do
    if "$python" -c 'import markdown' 2>/dev/null; then
        rm -rf "$1"
        exec "$python" docs/site/make_site.py . "$1"
    fi
done
echo "There is no Python with Markdown: install python3-markdown." >&2
exit 1
