#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""make_optics.py ROOT FILE.js: the library's optics as one script for a browser, WebAssembly inside, by Debian's emscripten."""
import pathlib
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
# Profiles and fits, of src/; the kernels are built once, for the level that any machine has.
SOURCES = '''
base/simd.c math/hankel.c math/nnls.c math/quadrature.c
optics/fit/fit.c optics/fit/gaussian_poles.c optics/fit/gaussian_sets.c optics/fit/gaussians.c optics/fit/kernels.c optics/fit/search.c
optics/fit/target.c optics/medium/dipole.c optics/medium/fresnel.c optics/medium/fresnel_rough.c optics/medium/half_space.c
optics/medium/inversion.c optics/medium/medium.c optics/medium/phase.c optics/medium/slab.c optics/medium/specular.c
optics/photon/photon.c optics/photon/single.c optics/photon/table.c optics/profile/better_dipole.c optics/profile/burley.c
optics/profile/dipole.c optics/profile/gaussians.c optics/profile/kernels.c optics/profile/monte_carlo.c optics/profile/nodes.c
optics/profile/normalized.c optics/profile/pair.c optics/profile/photon_beam.c optics/profile/profile.c optics/profile/sampling.c
optics/profile/table.c
'''.split()


def main():
    root, out = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve()
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        table = pathlib.Path(folder) / 'photon_table.c'
        subprocess.run([sys.executable, root / 'scripts/gen_profiles.py', '--header', root / 'src/optics/photon/table.h', '--output', table,
                        root / 'data/profiles/monte-carlo.json'], check=True)
        sources = [*(root / 'src' / s for s in SOURCES), table, HERE / 'bench.c', HERE / 'lmder.c']
        for parent in {s.parent for s in sources}: # files of one name get a folder each
            there = pathlib.Path(folder) / parent.name
            there.mkdir(exist_ok=True)
            subprocess.run(['emcc', '-c', '-O2', '-std=gnu11', '-DPELL_SIMD_NAME=base', f'-I{HERE}', f'-I{root / "src"}',
                            f'-I{root / "include"}', *(s for s in sources if s.parent == parent)], check=True, cwd=there)
        # linked without -O2: that would need acorn, which emscripten only recommends
        subprocess.run(['emcc', '-O1', *pathlib.Path(folder).rglob('*.o'), '-sSINGLE_FILE=1', '-sMODULARIZE=1', '-sEXPORT_NAME=makeOptics',
                        '-sALLOW_MEMORY_GROWTH=1', '-sFILESYSTEM=0', '-sENVIRONMENT=web,node', '-sEXPORTED_FUNCTIONS=_malloc,_free',
                        '-sEXPORTED_RUNTIME_METHODS=UTF8ToString', '-o', out], check=True)
    print(f'{out}: {out.stat().st_size} bytes')


if __name__ == '__main__':
    main()
