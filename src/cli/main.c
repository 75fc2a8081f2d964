/* SPDX-License-Identifier: MIT
 * main.c - the table of commands. */
#include "cli/cli.h"

static const struct command commands[] = {
    { "render", "INPUT", "an image, a turntable or an animation of a scene or a mesh",
      "INPUT is a glTF (.gltf, .glb), an OBJ, a PLY, an STL, or a scene file (.json). A mesh without a scene file is rendered with a "
      "camera that frames it, three soft studio lights, a grey backdrop and the material of --material.\n"
      "\n"
      "The unit of glTF is the metre. OBJ, PLY and STL have no unit: give the size of the object (--size 70mm, its largest extent) or the "
      "unit of the file (--unit 1mm), because the scattering distance relative to the object depends on it.\n"
      "\n"
      "Options of the command line override those of a scene file. PNG holds the exposed image; EXR, HDR and PFM hold linear "
      "radiance without exposure, and EXR also holds all layers.\n",
      "  pellucid render bunny.obj --material wholemilk --size 70mm -o bunny.png\n"
      "  pellucid render bunny.obj --material wholemilk --size 70mm -m none -o plain.png  # no scattering\n"
      "  pellucid render head.gltf --material skin --set gaussians=6 -o head.exr          # with layers\n"
      "  pellucid render scene.json --width 1920 --height 1080 --msaa 8 --stats\n"
      "  pellucid render scene.json --turntable 4 -o turn.png     # turn_0000.png, turn_0001.png, ...\n"
      "  pellucid render scene.json --frames 0:2:0.25 -o walk.png # its animation, walk_0000.png, ...\n"
      "  pellucid render scene.json --dof on --msaa 64 --bloom 0.1\n"
      "  pellucid render bunny.obj --size 70mm --material jade --max-error 12%  # chooses\n",
      OPTIONS_SCENE | OPTIONS_METHOD | OPTIONS_CHOICE | OPTIONS_PICTURE | OPTIONS_FILE | OPTIONS_PARTS | OPTIONS_ENGINE, 1, 1,
      command_render },
    { "merge", "PART...", "the image of the parts of a path-traced image that several runs made",
      "PARTs are checkpoints of `render -m path-trace` with --sample-range, --tile-range or neither. The image is bit-identical to that of "
      "one run with all samples. Parts with a different scene, seed, knob or program version are refused with the difference, and so are "
      "parts that overlap or leave gaps; --partial accepts gaps. The scene and the options come from the first part; relative paths in it "
      "start at the current folder.\n",
      "  pellucid render scene.json -m path-trace --samples 8 --sample-range 0/2 --checkpoint a.ckpt\n"
      "  pellucid render scene.json -m path-trace --samples 8 --sample-range 1/2 --checkpoint b.ckpt\n"
      "  pellucid merge a.ckpt b.ckpt -o milk.exr\n"
      "  pellucid merge a.ckpt --partial -o half.exr\n",
      OPTIONS_MERGE | OPTIONS_ENGINE, 1, 100000, command_merge },
    { "check", "INPUT", "contents and problems of a scene, without rendering",
      "Reads INPUT as `render` would, and reports its objects, materials, size and problems: open surfaces, inverted normals, an "
      "implausible scale, objects thinner than a mean free path. Exit code 3 if INPUT can't be read or a problem is an error.\n"
      "\n"
      "With --cross-section it also plots the layers of a material below a line on the surface, constant or texture-mapped, in mm.\n",
      "  pellucid check bunny.obj --size 70mm --material wholemilk\n"
      "  pellucid check scene.json --json\n"
      "  pellucid check scene.json --cross-section layers.svg --down-to 2mm\n",
      OPTIONS_SCENE | OPTIONS_CHECK, 1, 1, command_check },
    { "bake-layers", "INPUT", "depth maps of the layers of `layered` from meshes inside a mesh",
      "INPUT is a closed mesh with texture coordinates (OBJ, PLY, glTF; OBJ and PLY need --size or --unit). From each texel of its layout "
      "a ray is cast along the inward normal through the closed meshes of --inner; the depth map of a layer holds the depth of its bottom. "
      "A mesh that a ray enters and leaves splits the medium into layers above, inside and below it: body, vessel, body; at most four such "
      "pairs per mesh are used.\n"
      "\n"
      "The folder contains layers-0.exr (the depths of four layer bottoms in mm, depth_scale 1mm), layers-1.exr and so on, and scene.json, "
      "a scene of the mesh with these layers. Its coefficients are examples; replace them by your own. It refers to the mesh outside its "
      "folder, so `render` needs --allow-outside.\n",
      "  pellucid bake-layers arm.obj --unit 1mm --inner vein=vein.obj -o arm-layers\n"
      "  pellucid bake-layers arm.obj --unit 1mm --inner vein=vein.obj --down-to 3mm -o near-layers\n"
      "  pellucid render arm-layers/scene.json --allow-outside -o arm.png\n",
      OPTIONS_BAKE, 1, 1, command_bake_layers },
    { "methods", "[NAME]", "the methods, or the knobs, paper and limits of one", "",
      "  pellucid methods\n"
      "  pellucid methods screen-space\n"
      "  pellucid methods --json\n",
      0, 0, 1, command_methods },
    { "materials", "[NAME|FILE]", "the built-in materials, or one with the source of its numbers",
      "NAME is a built-in name, FILE a material file (.json), as --material takes them.\n",
      "  pellucid materials\n"
      "  pellucid materials wholemilk\n",
      0, 0, 1, command_materials },
    { "profile", "[MATERIAL|FILE]", "diffusion profiles: R(r), T(r) of slabs, fits, plots, code for engines",
      "MATERIAL is a built-in name (`pellucid materials`), FILE a material file (.json) or a table of your own (.csv: rows r_mm,R,G,B in "
      "mm and 1/mm^2, optionally after a line of column names; the output of --csv can be read, T and other models are ignored). The "
      "output is R(r), the flux that leaves per mm^2 at distance r from where light enters, its total, and a sum of Gaussians fitted "
      "to it, with error (10) of d'Eon et al. 2007: sqrt(Int r (R - G)^2 dr / Int r R^2 dr).\n"
      "\n"
      "Models: dipole (Jensen et al. 2001), better-dipole (d'Eon 2012), normalized-diffusion (Christensen and Burley 2015), photon-beam "
      "(Habel et al. 2013), monte-carlo (a table of simulated photons).\n",
      "  pellucid profile marble\n"
      "  pellucid profile marble --gaussians 6 --shared -o marble.svg\n"
      "  pellucid profile marble --gaussians 2,4 --weighted -o figure-2.svg   # 2 pi r R(r)\n"
      "  pellucid profile wax.json --csv -o wax.csv --points 200\n"
      "  pellucid profile wholemilk --export glsl --taps 17 -o milk.glsl\n"
      "  pellucid profile --skin melanin=0.2 --solver gaussian --json\n"
      "  pellucid profile --wavelength 500nm --solver all -o figure-12.svg\n",
      OPTIONS_PROFILE, 0, 1, command_profile },
    { "bench", "[SCENE]", "times of the stages on this machine",
      "Renders SCENE cold and warm and prints a row per stage: milliseconds, pixels, rays, and the time to copy the same number of "
      "bytes, measured in the same run; then rows for the whole frame, for one thread and for the object farther away. SCENE is one "
      "of the bench folder (screen-space) or your own scene file. The benches of the papers are a separate program, which is built "
      "from the source: bench/README.md.\n",
      "  pellucid bench\n"
      "  pellucid bench screen-space --threads 1 --json\n",
      OPTIONS_METHOD | OPTIONS_PICTURE | OPTIONS_ENGINE | OPTIONS_BENCH, 0, 1, command_bench },
    { "compare", "INPUT|A B", "errors of methods on a scene, or of an image, against a reference",
      "INPUT is a scene or a mesh, as for `render`, or a list of scenes (.txt, one path per line), each written to a folder of its name in "
      "-o. Every method of --methods and the reference render it with the same exposure; the table lists the error of each method, for the "
      "subsurface light of translucent pixels and for the whole image. With two "
      "references, the first is also measured against the second: the error of the model, separate from the error of the methods.\n"
      "\n"
      "A and B are images of the same size (exr, hdr, pfm, png, jpg), from any program: both linear light, or both display values. "
      "The output is the mean squared, relative squared and absolute error, the bias of each channel, SSIM (Wang et "
      "al. 2004) and FLIP (Andersson et al. 2020; of linear light also HDR-FLIP, 2021), over the pixels of a mask and over the whole "
      "image. SSIM and FLIP are computed on display values: both images with the exposure and the curve of B.\n"
      "\n"
      "To account for the noise of a sampled reference, render it twice, with two seeds, and give the second image as --half; dipole, "
      "single-scatter "
      "and path-trace estimate their own noise. -o writes report.html, a single file for any browser, and metrics.json into a "
      "folder; for a scene, also every image as EXR and its errors; for two images, relative.png (blue: too dark, red: too bright, "
      "+-50 %), flip.png, flip_hdr.png (black 0, light yellow 1) and errors.exr with their values.\n",
      "  pellucid compare bunny.obj --material wholemilk --size 70mm -o report/\n"
      "  pellucid compare bunny.obj --size 70mm --material marble --methods screen-space:gaussians=6,none\n"
      "  pellucid render bunny.obj --material wholemilk --size 70mm -o milk.exr\n"
      "  pellucid render bunny.obj --material wholemilk --size 70mm -m none -o plain.exr\n"
      "  pellucid compare plain.exr milk.exr\n"
      "  pellucid compare plain.exr milk.exr -o errors/\n"
      "  pellucid compare plain.exr milk.exr --layer diffuse.multiple --json\n",
      OPTIONS_SCENE | OPTIONS_PICTURE | OPTIONS_ENGINE | OPTIONS_COMPARE, 1, 2, command_compare },
#ifdef PELL_VIEWER
    { "view", "INPUT", "interactive view of a scene in a browser, with its error against a reference",
      "Prints an address to open in a browser on this machine, and opens it if there is a desktop. INPUT and the options are those of "
      "`render`; everything can be changed in the page. While the object moves, the image is reduced so that it renders within 80 ms. When "
      "the view is static, it is refined to the image of `pellucid render`; then a reference accumulates in the background, with the error "
      "of the method against it.\n"
      "\n"
      "The page is served to this machine only, and requires the token in its address. From another machine use ssh -L, or --listen. With "
      "--port and --token-file, pages reconnect after a restart. Files of the scene are reloaded when they change. The program ends at "
      "Ctrl-C, after ten minutes without a page, or after an hour if none has come: --end-after sets another time.\n",
      "  pellucid view bunny.obj --material wholemilk --size 70mm\n"
      "  pellucid view scene.json --no-open --port 8000\n"
      "  pellucid view scene.json --port 8000 --token-file viewer-token\n",
      OPTIONS_SCENE | OPTIONS_METHOD | OPTIONS_PICTURE | OPTIONS_ENGINE | OPTIONS_VIEW, 1, 1, command_view },
#endif
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
                 "  pellucid render bunny.obj --material wholemilk --size 70mm -o bunny.png\n",
        .commands = commands,
        .num_commands = PELL_COUNT(commands),
#ifndef PELL_VIEWER
        .absent = { "view", "this build has no viewer: it was made without libwebsockets, or with -Dviewer=disabled",
                    "install libwebsockets-dev (libwebsockets-devel), and build with -Dviewer=enabled" },
#endif
    };

    return cli_main(&program, argc, argv);
}
