#!/bin/sh
# SPDX-License-Identifier: MIT
# make_docs.sh FOLDER: docs/site/make_site.py, by a Python that has Markdown.
set -eu

cd "$(dirname "$0")/.."
for python in python3 /usr/bin/python3; do
    if "$python" -c 'import markdown' 2>/dev/null; then
        rm -rf "$1"
        optics=
        if command -v emcc >/dev/null; then
            optics=$(mktemp -d)/optics.js
            "$python" docs/site/bench/make_optics.py . "$optics"
        else
            echo "The profile bench is left out: there is no emcc (package emscripten)." >&2
        fi
        "$python" docs/site/make_site.py . "$1" ${optics:+"$optics"}
        if [ -n "$optics" ]; then
            rm -r "$(dirname "$optics")"
        fi
        exit 0
    fi
done
echo "There is no Python with Markdown: install python3-markdown." >&2
exit 1
