#!/usr/bin/env python3
"""Write the seed corpus of the glTF fuzz target: small documents that between them use every
feature of the importer. Usage: make_data.py [REPOSITORY]; the output is the same every time."""
import base64
import json
import pathlib
import struct
import sys
import zlib

F32, U8, U16, U32, I16 = 5126, 5121, 5123, 5125, 5122
FORMATS = {F32: "f", U8: "B", U16: "H", U32: "I", I16: "h"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def png(width, height, rgb):
    def chunk(kind, data):
        return (struct.pack(">I", len(data)) + kind + data
                + struct.pack(">I", zlib.crc32(kind + data)))
    rows = (b"\0" + bytes(rgb) * width) * height
    return (b"\x89PNG\r\n\x1a\n"
            + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


class Document:
    def __init__(self, **members):
        self.json = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": [], **members}
        self.data = b""

    def view(self, data, **members):
        self.data += b"\0" * (-len(self.data) % 4)
        self.json["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **members})
        self.data += data
        return len(self.json["bufferViews"]) - 1

    def add(self, numbers, component, kind, **members):
        data = struct.pack("<%d%s" % (len(numbers), FORMATS[component]), *numbers)
        self.json["accessors"].append(
            {"bufferView": self.view(data), "componentType": component, "type": kind,
             "count": len(numbers) // WIDTHS[kind], **members})
        return len(self.json["accessors"]) - 1

    def gltf(self):
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        buffers = [{"byteLength": len(self.data), "uri": uri}]
        return json.dumps({**self.json, "buffers": buffers}).encode()

    def glb(self):
        text = json.dumps({**self.json, "buffers": [{"byteLength": len(self.data)}]}).encode()
        text += b" " * (-len(text) % 4)
        data = self.data + b"\0" * (-len(self.data) % 4)
        body = (struct.pack("<I4s", len(text), b"JSON") + text
                + struct.pack("<I4s", len(data), b"BIN\0") + data)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


TRIANGLE = [0, 0, 0, 1, 0, 0, 0, 1, 0]
SQUARE = TRIANGLE + [1, 1, 0]


def strips():
    d = Document(nodes=[{"mesh": 0, "scale": [-1, 1, 1]}])
    position = d.add(SQUARE, F32, "VEC3")
    index = d.add([0, 1, 2, 3], U8, "SCALAR")
    d.json["meshes"] = [{"primitives": [
        {"attributes": {"POSITION": position}, "indices": index, "mode": mode}
        for mode in range(7)]}]
    return d


def textured():
    d = Document(extensionsUsed=["KHR_texture_transform", "KHR_materials_specular"])
    attributes = {"POSITION": d.add(SQUARE, F32, "VEC3"),
                  "NORMAL": d.add([0, 0, 1] * 4, F32, "VEC3"),
                  "TEXCOORD_0": d.add([0, 0, 65535, 0, 0, 65535, 0, 0], U16, "VEC2",
                                      normalized=True),
                  "TEXCOORD_1": d.add([0, 0, 255, 0, 0, 255, 0, 0], F32, "VEC2"),
                  "COLOR_0": d.add([255, 0, 0, 255] * 4, U8, "VEC4", normalized=True)}
    d.json["images"] = [{"bufferView": d.view(png(2, 2, (128, 128, 255))),
                         "mimeType": "image/png"}]
    d.json["samplers"] = [{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}]
    d.json["textures"] = [{"source": 0, "sampler": 0}]
    info = {"index": 0, "texCoord": 1, "extensions": {"KHR_texture_transform": {
        "offset": [0.5, 0], "rotation": 1.0, "scale": [2, -1], "texCoord": 0}}}
    d.json["materials"] = [{
        "normalTexture": {"index": 0, "scale": 0.5}, "emissiveTexture": info,
        "emissiveFactor": [1, 0.5, 0], "alphaMode": "MASK", "alphaCutoff": 0.5,
        "doubleSided": True,
        "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.5], "metallicFactor": 0,
                                 "baseColorTexture": info, "metallicRoughnessTexture": info},
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 2},
                       "KHR_materials_ior": {"ior": 1.4}, "KHR_materials_unlit": {},
                       "KHR_materials_specular": {"specularTexture": info}}}]
    d.json["meshes"] = [{"primitives": [{
        "attributes": attributes, "material": 0,
        "indices": d.add([0, 1, 2, 1, 3, 2], U16, "SCALAR")}]}]
    d.json["nodes"] = [{"mesh": 0}]
    return d


def moving():
    d = Document()
    position = d.add(TRIANGLE, F32, "VEC3")
    d.json["meshes"] = [{"weights": [0.5], "primitives": [{
        "attributes": {"POSITION": position, "JOINTS_0": d.add([0, 1, 0, 0] * 3, U8, "VEC4"),
                       "WEIGHTS_0": d.add([0.5, 0.5, 0, 0] * 3, F32, "VEC4")},
        "targets": [{"POSITION": d.add([0, 0, 1] * 3, F32, "VEC3")}]}]}]
    identity = [float(i % 5 == 0) for i in range(16)]
    d.json["skins"] = [{"joints": [1, 2],
                        "inverseBindMatrices": d.add(identity * 2, F32, "MAT4")}]
    d.json["nodes"] = [{"mesh": 0, "skin": 0}, {"children": [2]}, {"translation": [0, 0, 1]}]
    times = d.add([0, 1], F32, "SCALAR")
    outputs = [(times, d.add([0, 0, 0, 1, 0, 0, 1, 0], F32, "VEC4"), "LINEAR"),
               (times, d.add([0, 0, 0, 0, 1, 0] * 3, F32, "VEC3"), "CUBICSPLINE"),
               (times, d.add([0, 1], F32, "SCALAR"), "STEP"),
               (times, d.add([0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0] * 2, F32, "VEC4"),
                "CUBICSPLINE")]
    targets = [(1, "rotation"), (1, "translation"), (0, "weights"), (2, "rotation")]
    d.json["animations"] = [{
        "samplers": [{"input": i, "output": o, "interpolation": how} for i, o, how in outputs],
        "channels": [{"sampler": s, "target": {"node": node, "path": path}}
                     for s, (node, path) in enumerate(targets)]}]
    return d


def sparse():
    d = Document(extensionsUsed=["KHR_mesh_quantization"],
                 extensionsRequired=["KHR_mesh_quantization"],
                 nodes=[{"mesh": 0, "matrix": [float(i % 5 == 0) for i in range(16)]}])
    quantized = d.add([0, 0, 0, 0, 9, 0, 0, 0, 0, 9, 0, 0], I16, "VEC4")
    d.json["accessors"][quantized].update({"type": "VEC3", "count": 3})
    d.json["bufferViews"][-1]["byteStride"] = 8
    d.json["accessors"].append({
        "componentType": F32, "type": "VEC3", "count": 3,
        "sparse": {"count": 2,
                   "indices": {"bufferView": d.view(struct.pack("<2H", 1, 2)),
                               "componentType": U16},
                   "values": {"bufferView": d.view(struct.pack("<6f", 1, 0, 0, 0, 1, 0))}}})
    d.json["meshes"] = [{"primitives": [{"attributes": {"POSITION": quantized}},
                                        {"attributes": {"POSITION": quantized + 1}}]}]
    return d


def lights():
    spot = {"innerConeAngle": 0.1, "outerConeAngle": 0.2}
    kinds = [{"type": "point"}, {"type": "spot", "spot": spot, "range": 3},
             {"type": "directional", "color": [1, 0.5, 0], "intensity": 2}]
    cameras = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1, "zfar": 9}},
               {"type": "orthographic",
                "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 9}}]
    nodes = [{"extensions": {"KHR_lights_punctual": {"light": i}}} for i in range(3)]
    nodes += [{"camera": 0, "rotation": [0, 1, 0, 0]}, {"camera": 1, "children": [0, 1]}]
    return Document(extensionsUsed=["KHR_lights_punctual", "EXT_unknown"],
                    extensions={"KHR_lights_punctual": {"lights": kinds}}, cameras=cameras,
                    nodes=nodes, scene=0, scenes=[{"nodes": [2, 3, 4]}])


def main():
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else __file__).resolve()
    root = root if len(sys.argv) > 1 else root.parents[2]
    corpus = root / "tests" / "fuzz" / "corpus" / "fuzz_gltf"
    corpus.mkdir(parents=True, exist_ok=True)
    for make in (strips, textured, moving, sparse, lights):
        document = make()
        (corpus / (make.__name__ + ".gltf")).write_bytes(document.gltf())
        (corpus / (make.__name__ + ".glb")).write_bytes(document.glb())


if __name__ == "__main__":
    main()
