#!/bin/sh
# SPDX-License-Identifier: MIT
# Renders the example scenes with ./pellucid, each beside the same without scattering, and prints where the pictures are.
set -eu
cd "$(dirname "$0")/.."

out=out/demo
examples=build/examples
bunny=/usr/share/glmark2/models/bunny.obj
mkdir -p "$out"

# picture NAME ARGUMENTS...: NAME.png, and NAME-plain.png without scattering
picture() {
    name=$1
    shift
    printf '  %s\n' "$name"
    ./pellucid render "$@" --quiet -o "$out/$name.png"
    ./pellucid render "$@" --quiet -m none -o "$out/$name-plain.png"
}

printf 'Rendering the examples, each with and without scattering:\n'
if [ -r "$bunny" ]; then
    picture bunny-wholemilk "$bunny" --material wholemilk --size 70mm --light-samples 48
else
    printf '  bunny-wholemilk: skipped, the package glmark2-data is not installed\n'
fi
picture marble "$examples/marble.json"
picture skin "$examples/skin.json"
picture wax "$examples/wax.json"
picture materials "$examples/materials.json"
for scene in fish leaf gecko veins; do
    picture "$scene" "$examples/$scene.json"
done

printf '\nThe pictures are in %s:\n' "$out"
ls "$out"/*.png
printf '\nNext: ./pellucid render YOUR.obj --material marble --size 100mm -o yours.png\n'
