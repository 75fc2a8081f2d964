#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""make_fuzz_seeds.py: writes the seeds of fuzz/scene/corpus/gltf. Small files that between them reach every part of the reader."""
import json
import pathlib
import struct
import zlib

OUT = pathlib.Path(__file__).resolve().parent.parent / "fuzz" / "scene" / "corpus" / "gltf"


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
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[kind]
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


def surfaces(extensions):
    b = Buffer()
    attributes, indices = square(b)
    picture = b.view(png())
    material = {
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": {"rotation": 0.3}}},
                                 "metallicRoughnessTexture": {"index": 1}},
        "normalTexture": {"index": 0, "scale": 0.5}, "emissiveFactor": [1, 0, 1], "emissiveTexture": {"index": 0},
        "alphaMode": "MASK", "extensions": extensions,
    }
    return glb(b.document(nodes=[{"mesh": 0}], meshes=[{"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}],
                          materials=[material], textures=[{"source": 0}, {"source": 0, "sampler": 0}],
                          samplers=[{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}],
                          images=[{"bufferView": picture, "mimeType": "image/png"}]), b.data)


def text():
    return json.dumps({
        "asset": {"version": "2.0"}, "nodes": [{"mesh": 0, "children": [1]}, {"name": "leaf"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "buffers": [{"byteLength": 36, "uri": "data:;base64," + "AAAA" * 11 + "AACA"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "images": [{"uri": "a%20picture.png"}], "extensionsUsed": ["KHR_materials_unlit"],
    }, indent=1).encode()


def main():
    OUT.mkdir(parents=True, exist_ok=True)
    medium = {"KHR_materials_volume": {"attenuationDistance": 0.001, "attenuationColor": [0.5, 0.3, 0.1]},
              "KHR_materials_volume_scatter": {"multiscatterColor": [0.6, 0.4, 0.2], "scatterAnisotropy": 0.1},
              "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 1}, "KHR_materials_ior": {"ior": 1.4}}
    thin = {"KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.5, "diffuseTransmissionColorTexture": {"index": 0}},
            "KHR_materials_specular": {"specularTexture": {"index": 0}}, "KHR_materials_transmission": {"transmissionFactor": 1},
            "KHR_materials_emissive_strength": {"emissiveStrength": 3}}
    seeds = {"shapes.glb": shapes(), "medium.glb": surfaces(medium), "thin.glb": surfaces(thin), "text.gltf": text(), "empty.glb": glb({})}
    for name, data in seeds.items():
        (OUT / name).write_bytes(data)
        print(f"{name}: {len(data)} bytes")


if __name__ == "__main__":
    main()
