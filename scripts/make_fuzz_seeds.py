#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""make_fuzz_seeds.py: writes the seeds of fuzz/scene/corpus/{gltf,material,profile_table}, fuzz/optics/corpus/optics,
fuzz/methods/corpus/{checkpoint,render} and fuzz/cli/corpus/options: small files that between them reach every part of what reads them."""
import json
import math
import pathlib
import struct
import zlib

FUZZ = pathlib.Path(__file__).resolve().parent.parent / "fuzz"


def glb(document, data=b""):
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    if data:
        data += bytes(-len(data) % 4)
        chunks += struct.pack("<II", len(data), 0x004E4942) + data
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def png():
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    rows = bytes([0, 255, 0, 0, 0, 255, 0, 0, 0, 0, 255, 255, 255, 255])
    header = struct.pack(">IIBBBBB", 2, 2, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b"")


class Buffer:
    """Collects binary data with its views and accessors."""

    def __init__(self):
        self.data, self.views, self.accessors = b"", [], []

    def view(self, data, **more):
        self.data += bytes(-len(self.data) % 4)
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more})
        self.data += data
        return len(self.views) - 1

    def accessor(self, form, component, kind, values, **more):
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}[kind]
        view = self.view(struct.pack("<%d%s" % (len(values), form), *values))
        self.accessors.append({"bufferView": view, "componentType": component, "count": len(values) // width, "type": kind, **more})
        return len(self.accessors) - 1

    def document(self, **more):
        return {"asset": {"version": "2.0"}, "buffers": [{"byteLength": len(self.data)}], "bufferViews": self.views,
                "accessors": self.accessors, **more}


def square(buffer):
    attributes = {
        "POSITION": buffer.accessor("f", 5126, "VEC3", [0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0]),
        "NORMAL": buffer.accessor("b", 5120, "VEC3", [0, 0, 127] * 4, normalized=True),
        "TEXCOORD_0": buffer.accessor("H", 5123, "VEC2", [0, 65535, 65535, 65535, 65535, 0, 0, 0], normalized=True),
        "COLOR_0": buffer.accessor("B", 5121, "VEC4", list(range(16)), normalized=True),
    }
    return attributes, buffer.accessor("H", 5123, "SCALAR", [0, 1, 2, 0, 2, 3])


def shapes():
    b = Buffer()
    attributes, indices = square(b)
    tangent = b.accessor("f", 5126, "VEC4", [1, 0, 0, 1] * 4)
    base = b.accessors[attributes["POSITION"]]
    sparse = {"count": 1, "indices": {"bufferView": b.view(b"\x02"), "componentType": 5121},
              "values": {"bufferView": b.view(struct.pack("<3f", 1, 1, 7))}}
    b.accessors.append({**base, "sparse": sparse})
    b.accessors.append({"componentType": 5126, "count": 4, "type": "VEC3", "sparse": sparse})
    spread = b.accessor("f", 5126, "VEC3", [0, 0, 0, 5, 0, 0])
    primitives = [
        {"attributes": {**attributes, "TANGENT": tangent}, "indices": indices, "material": 0},
        {"attributes": {"POSITION": tangent + 1}, "mode": 5},
        {"attributes": {"POSITION": tangent + 2}, "mode": 6},
        {"attributes": {"POSITION": 0}, "mode": 1},
    ]
    nodes = [
        {"name": "top", "scale": [-1, 2, 1], "rotation": [0, 0.6, 0, 0.8], "translation": [1, 2, 3], "children": [1, 2]},
        {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]},
        {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": spread}}}},
        {"camera": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}},
    ]
    lights = [{"type": "spot", "intensity": 5, "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.5}, "range": 3}]
    return glb(b.document(scene=0, scenes=[{"nodes": [0, 3]}], nodes=nodes, meshes=[{"primitives": primitives}], materials=[{}],
                          cameras=[{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}],
                          extensions={"KHR_lights_punctual": {"lights": lights}}), b.data)


def deforming():
    """A square with a skin, morph targets, and an animation of all animatable properties."""
    b = Buffer()
    attributes, indices = square(b)
    attributes |= {
        "TANGENT": b.accessor("f", 5126, "VEC4", [1, 0, 0, 1] * 4),
        "JOINTS_0": b.accessor("B", 5121, "VEC4", [0, 1, 0, 0] * 4),
        "WEIGHTS_0": b.accessor("f", 5126, "VEC4", [1, 0, 0, 0, 0.5, 0.5, 0, 0] * 2),
        "JOINTS_1": b.accessor("H", 5123, "VEC4", [1, 0, 0, 0] * 4),
        "WEIGHTS_1": b.accessor("B", 5121, "VEC4", [0, 0, 0, 0, 60, 0, 0, 0] * 2, normalized=True),
    }
    targets = [
        {"POSITION": b.accessor("f", 5126, "VEC3", [0, 0, 1] * 4), "NORMAL": b.accessor("b", 5120, "VEC3", [9, 0, 0] * 4, normalized=True),
         "TANGENT": b.accessor("h", 5122, "VEC3", [0, 900, 0] * 4, normalized=True)},
        {"POSITION": b.accessor("f", 5126, "VEC3", [1, 0, 0] * 4)},
    ]
    inverse = b.accessor("f", 5126, "MAT4", ([1, 0, 0, 0] + [0, 1, 0, 0] + [0, 0, 1, 0] + [0, 0, 0, 1]) * 2)
    times = b.accessor("f", 5126, "SCALAR", [0, 0.25, 1])
    outputs = {
        "weights": ("LINEAR", b.accessor("f", 5126, "SCALAR", [0, 0, 1, 0.5, 0, 1])),
        "translation": ("CUBICSPLINE", b.accessor("f", 5126, "VEC3", [0, 1, 0] * 9)),
        "rotation": ("LINEAR", b.accessor("h", 5122, "VEC4", [0, 0, 0, 32767, 0, 0, 23170, 23170, 0, 0, 32767, 0], normalized=True)),
        "scale": ("STEP", b.accessor("f", 5126, "VEC3", [1, 1, 1, 1, 2, 1, -1, 1, 1])),
    }
    samplers = [{"input": times, "output": index, "interpolation": kind} for kind, index in outputs.values()]
    channels = [{"sampler": i, "target": {"node": 0 if path == "weights" else 2, "path": path}} for i, path in enumerate(outputs)]
    nodes = [{"mesh": 0, "skin": 0}, {"children": [2]}, {"translation": [0, 1, 0]}, {"mesh": 0, "weights": [0.5, 0]}]
    mesh = {"primitives": [{"attributes": attributes, "indices": indices, "targets": targets}], "weights": [0.25, 0]}
    return glb(b.document(nodes=nodes, meshes=[mesh], skins=[{"joints": [1, 2], "inverseBindMatrices": inverse, "skeleton": 1}],
                          animations=[{"name": "all", "samplers": samplers, "channels": channels}]), b.data)


def surfaces(extensions, picture=None, kind="image/png"):
    b = Buffer()
    attributes, indices = square(b)
    picture = b.view(picture or png())
    material = {
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": {"rotation": 0.3}}},
                                 "metallicRoughnessTexture": {"index": 1}},
        "normalTexture": {"index": 0, "scale": 0.5}, "emissiveFactor": [1, 0, 1], "emissiveTexture": {"index": 0},
        "alphaMode": "MASK", "extensions": extensions,
    }
    return glb(b.document(nodes=[{"mesh": 0}], meshes=[{"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}],
                          materials=[material], textures=[{"source": 0}, {"source": 0, "sampler": 0}],
                          samplers=[{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}],
                          images=[{"bufferView": picture, "mimeType": kind}]), b.data)


def text():
    return json.dumps({
        "asset": {"version": "2.0"}, "nodes": [{"mesh": 0, "children": [1]}, {"name": "leaf"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "buffers": [{"byteLength": 36, "uri": "data:;base64," + "AAAA" * 11 + "AACA"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "images": [{"uri": "a%20picture.png"}], "extensionsUsed": ["KHR_materials_unlit"],
    }, indent=1).encode()


def gltf():
    medium = {"KHR_materials_volume": {"attenuationDistance": 0.001, "attenuationColor": [0.5, 0.3, 0.1]},
              "KHR_materials_volume_scatter": {"multiscatterColor": [0.6, 0.4, 0.2], "scatterAnisotropy": 0.1},
              "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 1}, "KHR_materials_ior": {"ior": 1.4}}
    thin = {"KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.5, "diffuseTransmissionColorTexture": {"index": 0}},
            "KHR_materials_specular": {"specularTexture": {"index": 0}}, "KHR_materials_transmission": {"transmissionFactor": 1},
            "KHR_materials_emissive_strength": {"emissiveStrength": 3}}
    # Textures of the formats that files contain or claim to contain, and of those that are refused by name.
    images = FUZZ / "image/corpus/image"
    pictures = {
        "jpeg.glb": surfaces({}, (images / "j2.jpg").read_bytes(), "image/jpeg"),
        "cmyk.glb": surfaces({}, (images / "cmyk.jpg").read_bytes(), "image/jpeg"),
        "palette.glb": surfaces({}, (images / "palette.png").read_bytes()),
        "rgb16.glb": surfaces({}, (images / "rgb16.png").read_bytes()),
        "jpeg_as_png.glb": surfaces({}, (images / "j2.jpg").read_bytes()),
        "exr.glb": surfaces({}, (images / "one.exr").read_bytes()),
        "hdr.glb": surfaces({}, (images / "a.hdr").read_bytes()),
        "webp.glb": surfaces({}, bytes.fromhex("524946461a000000574542505650384c0d0000002f00000010071011118888fe0700"), "image/webp"),
        "ktx2.glb": surfaces({}, b"\xabKTX 20\xbb\r\n\x1a\n" + struct.pack("<9I", 0, 1, 4, 4, 0, 0, 1, 1, 1), "image/ktx2"),
    }
    return {**pictures, "shapes.glb": shapes(), "medium.glb": surfaces(medium), "thin.glb": surfaces(thin), "text.gltf": text(),
            "empty.glb": glb({}), "deforming.glb": deforming()}


# --- Material files -----------------------------------------------------------------------------------------------------------------

def materials():
    coefficients = {"sigma_a": [0.1, 0.2, 0.3], "sigma_s_reduced": [1, 2, 3]}
    colors = {"color": [0.8, 0.5, 0.4], "roughness": 0.4, "mix": 0.3, "color_from": "texture"}
    sums = {"variances": [0.1, 1, 10], "weights": [[0.2, 0.3, 0.4], [0.3, 0.3, 0.3], [0.1, 0.05, 0]]}
    layers = [{"name": "film", "thickness_mm": 0.2, "sigma_a": [0.1, 0.1, 0.5], "sigma_s": [40, 50, 60], "g": 0.8, "eta": 1.4},
              {"thickness_mm": 0.5, "sigma_a": [0, 0, 0], "sigma_s": [1, 2, 3], "phase": "rayleigh", "eta": 1.33},
              {"thickness_mm": 1, "sigma_a": [1, 1, 1], "sigma_s_reduced": [8, 8, 8], "phase": "schlick", "g": [0.5, 0, -0.5]},
              {"name": "bottom", "thickness_mm": "infinite", "phase": "hg", **coefficients}]
    files = {
        "medium": {"name": "soap", "title": "Soap", "eta": 1.5, **coefficients, **colors},
        "unreduced": {"kind": "medium", "sigma_a": [0.1, 0.2, 0.3], "sigma_s": [10, 20, 30], "g": [0.9, 0, -0.5], "eta": 1},
        "concentration": {"concentration": 0.25, "dilution": 100, **coefficients},
        "same_medium": {"same_medium_as": "regular-milk", "concentration": 10, "eta": 1.4},
        "gaussians": {"kind": "gaussians", "eta": 1.4, "note": "artistic", **sums, **colors},
        "same_profile": {"same_profile_as": "skin-6gaussian", "family": "artistic"},
        "layers": {"kind": "layers", "eta": 1.4, "layers": layers, "source": "none"},
        "slab": {"layers": layers[:1]},
        "solved": {"layers": layers[-1:], "variances": [0.1, 1], "weights": [[0.1, 0.2, 0.3], [0.2, 0.2, 0.2]]},
        "skin": {"skin": {"melanin": 0.1, "melanin_blend": 0.5, "haemoglobin": 0.02,
                          "oxygenation": 0.6, "epidermis_mm": 0.12, "eta": 1.38}},
        "skin_default": {"skin": {}},
    }
    return {f"{name}.json": json.dumps(content).encode() for name, content in files.items()}


# --- Tables -------------------------------------------------------------------------------------------------------------------------

def tables():
    radii = [0.1 * 1.2**i for i in range(24)]
    rows = "".join(f"{r:.4g},{0.1 * math.exp(-r):.4g},{0.05 * math.exp(-2 * r):.4g},0\n" for r in radii)
    return {
        "rgb.csv": b"r_mm,R,G,B\n" + rows.encode(),
        "one.csv": b"\xef\xbb\xbf# mine\r\nr_mm, R\r\n\r\n0 , 0.2\r\n1,0.1\r\n 2, 0\r\n",
        "bare.csv": b"0,0.2,0.2,0\r1,0.1,0.1,0\r2,0,0,0",
        "long.csv": b"".join(b"%d,1e-9\n" % r for r in range(700)),
        "ends.csv": b"1e-12,1e24\n2e-12,0\n1e12,1e-30\n",
    }


# --- Numbers ------------------------------------------------------------------------------------------------------------------------

def real(*values):
    """As fuzz/optics/fuzz_optics.c reads numbers: doubles as they are."""
    return b"".join(b"\0" + struct.pack("<d", value) for value in values)


def signed(value):
    return bytes([value < 0]) + real(abs(value))


def medium(a, s, g, eta):
    return (real(a, s) + signed(g)) * 3 + real(eta)


def stack(layers, endless=False, eta=1.4):
    """Layers of (sigma_a, sigma_s', thickness), all of one index."""
    body = b"".join(real(a, s, eta, d) for a, s, d in layers)
    return bytes([2 | 32 * endless, len(layers), 0]) + body


def numbers():
    probe = b"\3\x40\x30" * 48
    marble, milk, ink = medium(0.0041, 2.62, 0, 1.5), medium(0.001, 3, 0.9, 1.3), medium(30, 1, -0.3, 1.33)
    skin = [(0.21, 4.8, 0.25), (0.016, 3.2, 0.2), (0.0085, 0.45, 1e3)]
    table = b"".join(real(r, 0.1 * math.exp(-r)) for r in (0, 0.3, 0.7, 1.5, 3, 6))
    model, profile = (lambda m, body: bytes([m + 1]) + body + b"\0\2"), bytes([0])
    seeds = {f"profile_{m}": profile + model(m, (marble, milk, ink, marble, milk)[m]) + probe for m in range(5)}
    seeds["profile_rough"] = profile + b"\1" + marble + b"\x08" + real(0.5) + b"\2" + probe
    seeds["profile_A"] = profile + b"\1" + marble + b"\x10" + real(3.0) + b"\2" + probe
    seeds["table"] = b"\1\0" + table
    seeds["table_scaled"] = b"\1\x1f" + b"\3\x10\x20" * 60
    seeds["dipole"] = b"\2" + real(0.0041, 2.62, 1.5) + signed(0.4) + real(0.18, 1.0, 0.9)
    for m in range(5):
        seeds[f"fit_{m}"] = b"\3" + bytes([2 + m, m & 1, 0, 0]) + model(m, (milk, marble, ink, milk, marble)[m])
    seeds["fit_table"] = b"\3" + bytes([4, 0, 1]) + real(5.0) + b"\1\0" + table
    seeds["fit_shared"] = b"\4" + bytes([4, 0, 0]) + model(0, marble) + model(1, milk) + b"\0" + model(2, ink)
    tail = real(0.5) + b"\0" + real(1.0) + b"\0"
    for name, layers in (("skin", stack(skin, endless=True)), ("slab", stack(skin[:1])), ("two", stack(skin[:2])),
                         ("clear", stack([(0, 1e-3, 1e-3), (0.1, 5, 1)])), ("white", stack([(0, 10, 1), (0, 1, 2)], eta=2.0))):
        seeds[f"stack_{name}"] = b"\5" + layers + tail
        seeds[f"hankel_{name}"] = b"\6" + layers + real(0, 0.01, 0.1, 1, 10, 100) + b"\1" + probe
        seeds[f"sets_{name}"] = b"\7\0" + layers + b"\3"
    seeds["sets_analytic"] = b"\7\1" + stack(skin, endless=True) + b"\5"
    seeds["sets_knobs"] = b"\7\x1e" + real(1e-4) + bytes([16]) + real(1e-4) + stack(skin[:2]) + b"\5"
    for kind in range(4):
        seeds[f"phase_{kind}"] = b"\x08" + bytes([kind]) + signed(0.8) + signed(-0.3) + real(0.7) + signed(0.2) + real(0.3, 0.6)
    for kind in range(6):
        look = b"".join(real(color, 1.5) + signed(0.2) for color in (0.8, 0.4, 0.1))
        seeds[f"look_{kind}"] = b"\x09" + bytes([kind % 3, 1 + kind % 5, 0, kind]) + real(1.4) + look
    seeds["material"] = b"\x0a\x1e" + real(0.5, 10.0, 1e-3)
    seeds["skin"] = b"\x0b" + real(0.05, 0.5, 0.02, 0.7, 0.1, 1.4, 550.0)
    seeds["kernel"] = b"\x0c" + real(10.0) + b"\x19\2" + real(5.0, 2.0) + b"\0" + model(1, marble)
    return seeds


def content_hash(data):
    """As src/base/hash.h has it, from 0."""
    value = 0
    for word in [len(data), *(w for w, in struct.iter_unpack("<Q", data + bytes(-len(data) % 8)))] + ([0] if len(data) % 8 == 0 else []):
        value = (value ^ word) * 0x9E3779B97F4A7C15 & 0xFFFFFFFFFFFFFFFF
        value ^= value >> 32
    return value


def checkpoints():
    """Films as fuzz_checkpoint.c expects them, and some that it must refuse. A film is its tiles: pixels, spans, numbers of each pixel."""
    def film(tiles):
        table = b"".join(struct.pack("<BH", pixels, len(spans)) + b"".join(struct.pack("<II", *span) for span in spans)
                         for pixels, spans, _ in tiles)
        sums = b"".join(number.to_bytes(16, "little", signed=True) for pixels, spans, numbers in tiles if spans
                        for _ in range(pixels) for number in numbers)
        return struct.pack("<Q", 7) + table + sums

    def file(films, width=11, version=2, seed=42, scene=0x0123456789ABCDEF, note=b"render", program=b"fuzz", events=0):
        data = b"PELLPT\r\n" + struct.pack("<IIIIQqiIf9i32s", version, width, 2, len(films), scene, seed, 0, len(note), 0.5, 0, 0, 0,
                                            events, 0, 0, 0, 0, 0, program) + note + b"".join(film(tiles) for tiles in films)
        return data + struct.pack("<Q", content_hash(data))

    none, some = [0] * 13, [(k + 1) << 62 for k in range(13)]
    void, one, many = [(0, [], none)] * 2, [(16, [(0, 4)], some), (6, [], none)], [(16, [(0, 4), (8, 9)], some), (6, [(1, 2)], none)]
    return {"empty": file([void, void], note=b""), "begun": file([one, void]), "whole": file([many, many]),
            "wide": file([void, void], width=12), "old": file([void, void], version=1), "other_seed": file([void, void], seed=41),
            "other_scene": file([void, void], scene=1), "other_knob": file([void, void], events=3),
            "other_program": file([void, void], program=b"0.0"), "one_film": file([one]),
            "negative": file([[(16, [(0, 4)], [-1] * 13), void[0]], void]),
            "large": file([[(16, [(0, 4)], [1 << 120] * 13), void[0]], void]),
            "crowded": file([[(17, [(0, 4)], some), void[0]], void]),
            "disordered": file([[(16, [(4, 8), (0, 4)], some), void[0]], void]), "short": b"PELLPT\r\n"}


# --- Scenes that are drawn, command lines -------------------------------------------------------------------------------------------

def scenes():
    """As fuzz_render.c reads them: a method, then a scene file."""
    medium = {"sigma_a": [0.01, 0.05, 0.2], "sigma_s_reduced": [2, 1.5, 1]}
    layers = [{"thickness_mm": 0.5, "sigma_a": [0.1, 0.1, 0.5], "sigma_s": [4, 5, 6], "g": 0.8}, {"thickness_mm": "infinite", **medium}]
    lights = [{"type": "point", "at": [30, 30, 30], "intensity": 900}, {"type": "environment", "color": [0.2, 0.3, 0.4]},
              {"type": "rect", "at": [0, 40, 0], "width": 9, "height": 9, "radiance": 4}]
    seeds = {}
    for number in range(10):
        scene = {"pellucid": 1, "mesh": "a.obj", "unit": "1mm", "camera": {"from": [20, 25, 40], "fov_deg": 30}, "lights": lights,
                 "materials": {"Skin": medium, "Cloth": {"opaque": True, "color": [0.5, 0.2, 0.1]}}, "ground": number % 2 == 0}
        seeds[f"medium_{number}"] = scene
        seeds[f"layers_{number}"] = {**scene, "camera": {"side": "34"}, "lights": [{"studio": "rim"}], "background": "transparent",
                                     "materials": {"*": {"layers": layers}}, "render": {"msaa": 2, "bounces": 2, "dof": True}}
    return {name: bytes([int(name[-1])]) + json.dumps(scene).encode() for name, scene in seeds.items()}


def command_lines():
    """As fuzz_options.c reads them: a command, then a word a line."""
    lines = {
        "render": (0, "bunny.obj -m screen-space --material milk --size 70mm -o a.png --width 640 --height 360 --set gaussians=6"),
        "frames": (0, "s.json --frames 0:2:0.25 --turntable 4 --exposure 2 --samples 64 --time-limit 5min --target-error 1%"),
        "around": (0, "a.obj --unit 1mm --up z --from 35,15 --studio rim --background #f0f0f0 --limit depth=9 --stats"),
        "parts": (0, "s.json -m path-trace --sample-range 0/4 --tile-range 1/2 --checkpoint a.ckpt --dump out --progress json"),
        "sky": (0, "a.glb --environment sky.hdr --environment-rotate 90 --environment-scale 0.5 --time 1.5 --animation walk"),
        "merge": (1, "a.ckpt b.ckpt --partial -o m.exr"), "check": (2, "s.json --json --cross-section a.svg --down-to 2mm"),
        "methods": (3, "screen-space --json"), "profile": (4, "marble --model dipole --csv --rank 2 --export glsl --slab 2mm"),
        "compare": (5, "a.exr b.exr --half c.exr --layer diffuse --mask m.png --methods none,dipole:samples=9 --references path-trace"),
        "view": (6, "s.json --no-open --port 8000 --token-file t --listen 0.0.0.0"), "bench": (7, "jensen --runs 3 --threads 2"),
        "help": (0, "--help"), "wrong": (0, "--widht 5"), "empty": (2, ""),
    }
    return {name: bytes([command]) + text.replace(" ", "\n").encode() for name, (command, text) in lines.items()}


def main():
    for folder, seeds in (("scene/corpus/gltf", gltf()), ("scene/corpus/material", materials()),
                          ("scene/corpus/profile_table", tables()), ("optics/corpus/optics", numbers()),
                          ("methods/corpus/checkpoint", checkpoints()), ("methods/corpus/render", scenes()),
                          ("cli/corpus/options", command_lines())):
        (FUZZ / folder).mkdir(parents=True, exist_ok=True)
        for name, data in seeds.items():
            (FUZZ / folder / name).write_bytes(data)
            print(f"{folder}/{name}: {len(data)} bytes")


if __name__ == "__main__":
    main()
