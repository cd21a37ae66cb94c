#!/usr/bin/env python3
"""Copy a .glb with one edit. The same edit gives the same bytes.

usage: edit_scene.py IN.glb OUT.glb color MATERIAL R G B      base colour of a material
       edit_scene.py IN.glb OUT.glb emission MATERIAL FACTOR  emission times FACTOR (at most 1)
       edit_scene.py IN.glb OUT.glb move NODE X Y Z           move a node
       edit_scene.py IN.glb OUT.glb remove NODE               a node without its mesh
       edit_scene.py IN.glb OUT.glb own NODE R G B            a material of its own for one object
       edit_scene.py IN.glb OUT.glb light NODE FACTOR         intensity of a punctual light times FACTOR
"""
import copy
import json
import struct
import sys


def find(items, name):
    return next(x for x in items if x.get("name") == name)


def edit(j, what, args):
    if what == "color":
        m = find(j["materials"], args[0])
        m["pbrMetallicRoughness"]["baseColorFactor"] = [float(x) for x in args[1:4]] + [1.0]
    elif what == "emission":
        m = find(j["materials"], args[0])
        m["emissiveFactor"] = [x * float(args[1]) for x in m["emissiveFactor"]]
    elif what == "move":
        n = find(j["nodes"], args[0])
        n["translation"] = [a + float(b) for a, b in zip(n.get("translation", [0, 0, 0]), args[1:4])]
    elif what == "remove":
        del find(j["nodes"], args[0])["mesh"]
    elif what == "own":
        n = find(j["nodes"], args[0])
        mesh = copy.deepcopy(j["meshes"][n["mesh"]])
        for p in mesh["primitives"]:
            m = copy.deepcopy(j["materials"][p["material"]])
            m["pbrMetallicRoughness"]["baseColorFactor"] = [float(x) for x in args[1:4]] + [1.0]
            p["material"] = len(j["materials"])
            j["materials"].append(m)
        n["mesh"] = len(j["meshes"])
        j["meshes"].append(mesh)
    elif what == "light":
        n = find(j["nodes"], args[0])
        light = n["extensions"]["KHR_lights_punctual"]["light"]
        light = j["extensions"]["KHR_lights_punctual"]["lights"][light]
        light["intensity"] = light.get("intensity", 1.0) * float(args[1])
    else:
        sys.exit("edit_scene.py: what is '%s'?" % what)


def main():
    source, out, what = sys.argv[1:4]
    with open(source, "rb") as f:
        data = f.read()
    size = struct.unpack("<I", data[12:16])[0]
    j = json.loads(data[20:20 + size])
    edit(j, what, sys.argv[4:])
    text = json.dumps(j, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + data[20 + size:]
    with open(out, "wb") as f:
        f.write(struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body)


if __name__ == "__main__":
    main()
