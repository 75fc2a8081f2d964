#!/bin/sh
# SPDX-License-Identifier: MIT
# demo.sh [BUILD]: renders the example scenes of a build folder (build) with ./pellucid, each next to the same without scattering, and
# writes a page that shows them.
set -eu
cd "$(dirname "$0")/.."

out=out/demo
examples=${1-build}/examples
bunny=/usr/share/glmark2/models/bunny.obj
page=$out/index.html
mkdir -p "$out"

cat >"$page" <<'END'
<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>Pellucid: the examples</title>
<style>
body { margin: 2rem auto; max-width: 76rem; padding: 0 1rem; font: 1rem/1.5 system-ui, sans-serif; color: #222; background: #f6f5f2 }
figure { margin: 0 0 2.5rem }
figure div { display: grid; grid-template-columns: repeat(auto-fit, minmax(18rem, 1fr)); gap: .5rem }
img { width: 100%; border-radius: .3rem }
code { overflow-wrap: anywhere }
@media (prefers-color-scheme: dark) { body { color: #ddd; background: #1c1b19 } }
</style>
<h1>Pellucid: the examples</h1>
<p>Each scene with its method, and without scattering (<code>-m none</code>).</p>
END

# picture NAME ARGUMENTS...: NAME.png, and NAME-plain.png without scattering
picture() {
    name=$1
    shift
    printf '  %s\n' "$name"
    start=$(date +%s)
    ./pellucid render "$@" --quiet -o "$out/$name.png"
    seconds=$(($(date +%s) - start))
    ./pellucid render "$@" --quiet -m none -o "$out/$name-plain.png"
    cat >>"$page" <<END
<figure>
<div><img src="$name.png" alt="$name"><img src="$name-plain.png" alt="$name without scattering"></div>
<figcaption><code>./pellucid render $* -o $name.png</code>, $seconds s</figcaption>
</figure>
END
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

printf '</html>\n' >>"$page"
printf '\nThe images are in %s. A browser shows them all: %s/%s\n' "$out" "$PWD" "$page"
printf '\nNext: ./pellucid render YOUR.obj --material marble --size 100mm -o yours.png\n'
