/* SPDX-License-Identifier: MIT
 * main.c - the table of commands. */
#include "cli/cli.h"

static const struct command commands[] = {
    { "render", "INPUT", "one picture of a scene or a mesh, a turntable of them, or an animation",
      "INPUT is a glTF (.gltf, .glb), an OBJ, a PLY, or a scene file (.json). A plain mesh needs no scene file: it gets a camera that "
      "frames it, a studio of three soft lights, a grey backdrop and the material that --material names.\n"
      "\n"
      "glTF says its unit (the metre). OBJ and PLY don't: say how large the object is (--size 70mm, its largest extent) or what one unit "
      "of "
      "the file is (--unit 1mm), since how deep light goes into an object depends on it.\n"
      "\n"
      "Options of the command line win over those of a scene file. PNG shows the exposed picture; EXR, HDR and PFM hold linear radiance "
      "without exposure, and EXR also holds all layers.\n",
      "  pellucid render bunny.obj --material wholemilk --size 70mm -o bunny.png\n"
      "  pellucid render bunny.obj --material wholemilk --size 70mm -m none -o plain.png  # unscattered\n"
      "  pellucid render head.gltf --material skin --set gaussians=6 -o head.exr          # with layers\n"
      "  pellucid render scene.json --width 1920 --height 1080 --msaa 8 --stats\n"
      "  pellucid render scene.json --turntable 4 -o turn.png     # turn_0000.png, turn_0001.png, ...\n"
      "  pellucid render scene.json --frames 0:2:0.25 -o walk.png # its animation, walk_0000.png, ...\n"
      "  pellucid render scene.json --dof on --msaa 64 --bloom 0.1\n",
      OPTIONS_SCENE | OPTIONS_METHOD | OPTIONS_PICTURE | OPTIONS_FILE | OPTIONS_ENGINE, 1, 1, command_render },
    { "check", "INPUT", "what a scene holds, and every problem; renders nothing",
      "Reads INPUT as `render` would, and reports its objects, materials, size and problems: open or turned surfaces, a scale that can't "
      "be meant, media that the object is too thin for. Exit code 3 if INPUT can't be read or a problem is an error.\n"
      "\n"
      "With --cross-section it also draws what lies below the surface: the layers of a material along a line, painted or even, in mm.\n",
      "  pellucid check bunny.obj --size 70mm --material wholemilk\n"
      "  pellucid check scene.json --json\n"
      "  pellucid check scene.json --cross-section layers.svg --down-to 2mm\n",
      OPTIONS_SCENE | OPTIONS_CHECK, 1, 1, command_check },
    { "methods", "[NAME]", "the methods, or all about one: its knobs, its paper, its limits", "",
      "  pellucid methods\n"
      "  pellucid methods screen-space\n"
      "  pellucid methods --json\n",
      0, 0, 1, command_methods },
    { "materials", "[NAME]", "the built-in materials, or one and where its numbers come from", "",
      "  pellucid materials\n"
      "  pellucid materials wholemilk\n",
      0, 0, 1, command_materials },
    { "profile", "[MATERIAL|FILE]", "how light spreads: R(r), T(r) of slabs, fits, plots, code for engines",
      "MATERIAL is a built-in name (`pellucid materials`), FILE a material file (.json) or a table of your own (.csv: rows r_mm,R,G,B in "
      "mm and 1/mm^2, or a line of names and columns in its order; what --csv writes is read again, T and other models passed over). "
      "Printed are R(r), the flux that leaves per mm^2 at a distance r from where light fell in, its total, and a sum of "
      "Gaussians fitted to it, with error (10) of d'Eon et al. 2007: sqrt(Int r (R - G)^2 dr / Int r R^2 dr).\n"
      "\n"
      "Models: dipole (Jensen et al. 2001), better-dipole (d'Eon 2012), normalized-diffusion (Christensen and Burley 2015), photon-beam "
      "(Habel et al. 2013), monte-carlo (a table made by photons).\n",
      "  pellucid profile marble\n"
      "  pellucid profile marble --gaussians 6 --shared -o marble.svg\n"
      "  pellucid profile marble --gaussians 2,4 --weighted -o figure-2.svg   # 2 pi r R(r)\n"
      "  pellucid profile wax.json --csv -o wax.csv --points 200\n"
      "  pellucid profile wholemilk --export glsl --taps 17 -o milk.glsl\n"
      "  pellucid profile --skin melanin=0.2 --solver gaussian --json\n"
      "  pellucid profile --wavelength 500nm --solver all -o figure-12.svg\n",
      OPTIONS_PROFILE, 0, 1, command_profile },
    { "bench", "[SCENE]", "times of the stages on this machine",
      "Renders SCENE cold and warm and prints a row per stage: milliseconds, pixels, rays, and the time of copying the same bytes, "
      "measured in the same run; then rows for the whole frame, for one thread and for the object farther away. SCENE is one of the "
      "bench folder (screen-space) or a scene file of your own. The benches of the papers are a program of their own, which is built "
      "from the source: bench/README.md.\n",
      "  pellucid bench\n"
      "  pellucid bench screen-space --threads 1 --json\n",
      OPTIONS_METHOD | OPTIONS_PICTURE | OPTIONS_ENGINE | OPTIONS_BENCH, 0, 1, command_bench },
    { "compare", "INPUT|A B", "methods on a scene, or two pictures, against a reference: numbers, a report",
      "INPUT is a scene or a mesh, as for `render`. Every method of --methods and the reference render it under one exposure; the table "
      "says how far each is from the reference: of the subsurface light of translucent pixels, and of the whole picture. With two "
      "references, the first is also measured against the second: the error of the model, apart from the error of the methods.\n"
      "\n"
      "A and B are pictures of one size (exr, hdr, pfm, png, jpg), from here or from another program: both linear light, or both as a "
      "display shows them. Printed are the mean squared, relative squared and absolute error, the bias of each channel, SSIM (Wang et "
      "al. 2004) and FLIP (Andersson et al. 2020; of linear light also HDR-FLIP, 2021), over the pixels of a mask and over the whole "
      "picture. SSIM and FLIP judge what is shown: both pictures under the exposure and the curve of B.\n"
      "\n"
      "A reference that was made by sampling has noise of its own: render it twice, with two seeds, and give the second as --half; dipole, "
      "single-scatter and path-trace tell their own. With -o a folder gets report.html, one file for any browser, and metrics.json; of a "
      "scene, every picture as EXR and the errors of each; of two pictures, relative.png (blue: too dark, red: too bright, +-50 %), "
      "flip.png, flip_hdr.png (black 0, light "
      "yellow 1) and errors.exr with the numbers behind them.\n",
      "  pellucid compare bunny.obj --material wholemilk --size 70mm -o report/\n"
      "  pellucid compare bunny.obj --size 70mm --material marble --methods screen-space:gaussians=6,none\n"
      "  pellucid render bunny.obj --material wholemilk --size 70mm -o milk.exr\n"
      "  pellucid render bunny.obj --material wholemilk --size 70mm -m none -o plain.exr\n"
      "  pellucid compare plain.exr milk.exr\n"
      "  pellucid compare plain.exr milk.exr -o errors/\n"
      "  pellucid compare plain.exr milk.exr --layer diffuse.multiple --json\n",
      OPTIONS_SCENE | OPTIONS_PICTURE | OPTIONS_ENGINE | OPTIONS_COMPARE, 1, 2, command_compare },
    { "info", "", "engines, devices, limits, formats, SIMD level, build", "",
      "  pellucid info\n"
      "  pellucid info --json\n",
      OPTIONS_ENGINE, 0, 0, command_info },
};

int main(int argc, char **argv)
{
    static const struct program program = {
        .name = "pellucid",
        .about = "renders translucent objects from measured optics",
        .start = "Start here\n"
                 "  pellucid render bunny.obj --material wholemilk --size 70mm -o bunny.png\n\n",
        .commands = commands,
        .num_commands = PELL_COUNT(commands),
    };

    return cli_main(&program, argc, argv);
}
