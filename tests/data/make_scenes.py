#!/usr/bin/env python3
"""Write the scenes of tests and demo: glTF 2.0 binaries whose light transport is known or easy to check.

Every surface is pure Lambert (KHR_materials_specular with specularFactor 0, metallic 0) but in still-life, every light is an
emissive surface but in sky.exr, lengths are metres, colours linear Rec.709. Only the Python standard library is needed, and
the same bytes come out on every machine.

usage: make_scenes.py OUTPUT_FOLDER [NAME...]
"""
import json
import math
import os
import struct
import sys

class Glb:
    def __init__(self):
        self.bin = bytearray()
        self.j = {"asset": {"version": "2.0", "generator": "keeplight tests/data/make_scenes.py"}, "scene": 0,
                  "scenes": [{"nodes": []}], "nodes": [], "meshes": [], "materials": [], "accessors": [],
                  "bufferViews": [], "buffers": [], "cameras": [], "extensionsUsed": []}

    def _use(self, name):
        if name not in self.j["extensionsUsed"]:
            self.j["extensionsUsed"].append(name)

    def accessor(self, fmt, kind, rows, target=None, minmax=False):
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[kind]
        flat = [v for r in rows for v in (r if isinstance(r, (tuple, list)) else (r,))]
        while len(self.bin) % 4:
            self.bin.append(0)
        off = len(self.bin)
        self.bin += struct.pack("<%d%s" % (len(flat), {5126: "f", 5125: "I"}[fmt]), *flat)
        view = {"buffer": 0, "byteOffset": off, "byteLength": len(self.bin) - off}
        if target:
            view["target"] = target
        self.j["bufferViews"].append(view)
        acc = {"bufferView": len(self.j["bufferViews"]) - 1, "componentType": fmt, "count": len(flat) // width, "type": kind}
        if minmax:
            cols = [flat[i::width] for i in range(width)]
            # min/max as the float32 values that are stored
            f32 = lambda v: struct.unpack("<f", struct.pack("<f", v))[0]
            acc["min"] = [f32(min(c)) for c in cols]
            acc["max"] = [f32(max(c)) for c in cols]
        self.j["accessors"].append(acc)
        return len(self.j["accessors"]) - 1

    def rows(self, accessor):
        """What a VEC3 accessor holds."""
        a = self.j["accessors"][accessor]
        at = self.j["bufferViews"][a["bufferView"]]["byteOffset"]
        return [struct.unpack_from("<3f", self.bin, at + 12 * i) for i in range(a["count"])]

    def material(self, name, albedo, emission=None, double_sided=False, roughness=1.0, metallic=0.0, lambert=True):
        m = {"name": name, "doubleSided": double_sided, "extensions": {},
             "pbrMetallicRoughness": {"baseColorFactor": list(albedo) + [1.0], "metallicFactor": metallic,
                                      "roughnessFactor": roughness}}
        if lambert:
            m["extensions"]["KHR_materials_specular"] = {"specularFactor": 0.0}
            self._use("KHR_materials_specular")
        if emission:
            peak = max(emission)
            m["emissiveFactor"] = [e / peak for e in emission] if peak > 1 else list(emission)
            if peak > 1:
                m["extensions"]["KHR_materials_emissive_strength"] = {"emissiveStrength": peak}
                self._use("KHR_materials_emissive_strength")
        if not m["extensions"]:
            del m["extensions"]
        self.j["materials"].append(m)
        return len(self.j["materials"]) - 1

    def mesh(self, name, parts):
        """parts: list of (material, positions, normals, triangles)."""
        prims = []
        for mat, pos, nrm, tri in parts:
            prims.append({"attributes": {"POSITION": self.accessor(5126, "VEC3", pos, 34962, True),
                                         "NORMAL": self.accessor(5126, "VEC3", nrm, 34962)},
                          "indices": self.accessor(5125, "SCALAR", [i for t in tri for i in t], 34963),
                          "material": mat, "mode": 4})
        self.j["meshes"].append({"name": name, "primitives": prims})
        return len(self.j["meshes"]) - 1

    def morph(self, mesh, shape):
        """Give a mesh of one part a target. shape: the part with other positions and normals."""
        part = self.j["meshes"][mesh]["primitives"][0]
        own = lambda name: self.rows(part["attributes"][name])
        shift = lambda name, to: self.accessor(5126, "VEC3", [sub(b, a) for a, b in zip(own(name), to)], None, True)
        part["targets"] = [{"POSITION": shift("POSITION", shape[0]), "NORMAL": shift("NORMAL", shape[1])}]
        self.j["meshes"][mesh]["weights"] = [0.0]

    def node(self, name, root=True, **kw):
        self.j["nodes"].append(dict({"name": name}, **kw))
        i = len(self.j["nodes"]) - 1
        if root:
            self.j["scenes"][0]["nodes"].append(i)
        return i

    def camera(self, name, yfov, aspect, **kw):
        self.j["cameras"].append({"name": name, "type": "perspective",
                                  "perspective": {"yfov": yfov, "aspectRatio": aspect, "znear": 0.01, "zfar": 1000.0}})
        return self.node(name, camera=len(self.j["cameras"]) - 1, **kw)

    def point_light(self, name, intensity, **kw):
        lights = self.j.setdefault("extensions", {}).setdefault("KHR_lights_punctual", {"lights": []})["lights"]
        lights.append({"name": name, "type": "point", "intensity": intensity})
        self._use("KHR_lights_punctual")
        return self.node(name, extensions={"KHR_lights_punctual": {"light": len(lights) - 1}}, **kw)

    def animation(self, name, channels):
        """channels: list of (node, path, times, values, interpolation); node None: path is a pointer."""
        a = {"name": name, "samplers": [], "channels": []}
        for node, path, times, values, mode in channels:
            kind = "VEC%d" % len(values[0]) if isinstance(values[0], (list, tuple)) else "SCALAR"
            target = {"node": node, "path": path}
            if node is None:
                target = {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": path}}}
                self._use("KHR_animation_pointer")
            a["samplers"].append({"input": self.accessor(5126, "SCALAR", times, None, True),
                                  "output": self.accessor(5126, kind, values), "interpolation": mode})
            a["channels"].append({"sampler": len(a["samplers"]) - 1, "target": target})
        self.j.setdefault("animations", []).append(a)

    def write(self, path):
        while len(self.bin) % 4:
            self.bin.append(0)
        self.j["buffers"] = [{"byteLength": len(self.bin)}]
        for k in ("cameras", "extensionsUsed"):  # empty lists are not allowed
            if not self.j[k]:
                del self.j[k]
        js = json.dumps(self.j, separators=(",", ":")).encode()
        js += b" " * (-len(js) % 4)
        with open(path, "wb") as f:
            f.write(struct.pack("<III", 0x46546C67, 2, 12 + 8 + len(js) + 8 + len(self.bin)))
            f.write(struct.pack("<II", len(js), 0x4E4F534A) + js)
            f.write(struct.pack("<II", len(self.bin), 0x004E4942) + bytes(self.bin))

def sub(a, b): return tuple(x - y for x, y in zip(a, b))
def cross(a, b): return (a[1]*b[2]-a[2]*b[1], a[2]*b[0]-a[0]*b[2], a[0]*b[1]-a[1]*b[0])
def unit(a):
    l = math.sqrt(sum(x*x for x in a)); return tuple(x / l for x in a)

def quads(list_of_quads):
    """Each quad: 4 corners, counter-clockwise seen from its front."""
    pos, nrm, tri = [], [], []
    for q in list_of_quads:
        n = unit(cross(sub(q[1], q[0]), sub(q[2], q[0])))
        b = len(pos)
        pos += [tuple(c) for c in q]
        nrm += [n] * 4
        tri += [(b, b+1, b+2), (b, b+2, b+3)]
    return pos, nrm, tri

def box(lo, hi, inside=False):
    x0, y0, z0 = lo; x1, y1, z1 = hi
    q = [[(x0,y0,z1),(x1,y0,z1),(x1,y1,z1),(x0,y1,z1)], [(x1,y0,z0),(x0,y0,z0),(x0,y1,z0),(x1,y1,z0)],
         [(x1,y0,z1),(x1,y0,z0),(x1,y1,z0),(x1,y1,z1)], [(x0,y0,z0),(x0,y0,z1),(x0,y1,z1),(x0,y1,z0)],
         [(x0,y1,z1),(x1,y1,z1),(x1,y1,z0),(x0,y1,z0)], [(x0,y0,z0),(x1,y0,z0),(x1,y0,z1),(x0,y0,z1)]]
    return [list(reversed(f)) for f in q] if inside else q

def lamp(g, light, faces):
    """Mesh parts of one-sided lamps: the emitting quads, each with a black quad 1 mm behind it, so that a renderer whose
    emission is two-sided agrees with one whose emission is one-sided."""
    black = g.material("lamp back", (0.0, 0.0, 0.0))
    backs = []
    for q in faces:
        n = unit(cross(sub(q[1], q[0]), sub(q[2], q[0])))
        backs.append([tuple(c[k] - 0.001 * n[k] for k in range(3)) for c in reversed(q)])
    return [(light, *quads(faces)), (black, *quads(backs))]

def sphere(c, r, n=48, inside=False):
    pos, nrm, tri = [], [], []
    for i in range(n + 1):
        t = math.pi * i / n
        for j in range(2 * n + 1):
            p = math.pi * j / n
            d = (math.sin(t) * math.cos(p), math.cos(t), -math.sin(t) * math.sin(p))
            pos.append(tuple(c[k] + r * d[k] for k in range(3)))
            nrm.append(tuple(-x for x in d) if inside else d)
    w = 2 * n + 1
    for i in range(n):
        for j in range(2 * n):
            a, b, e, f = i*w+j, (i+1)*w+j, (i+1)*w+j+1, i*w+j+1
            t = [(a, b, e)] if i < n - 1 else []
            t += [(a, e, f)] if i > 0 else []
            tri += [tuple(reversed(x)) for x in t] if inside else t
    return pos, nrm, tri

def look_at(eye, target, up=(0, 1, 0)):
    """Rotation quaternion (x, y, z, w) of a glTF camera: it looks along its own -Z."""
    z = unit(sub(eye, target)); x = unit(cross(up, z)); y = cross(z, x)
    m = [[x[0], y[0], z[0]], [x[1], y[1], z[1]], [x[2], y[2], z[2]]]
    t = m[0][0] + m[1][1] + m[2][2]
    if t > 0:
        s = math.sqrt(t + 1) * 2; q = ((m[2][1]-m[1][2])/s, (m[0][2]-m[2][0])/s, (m[1][0]-m[0][1])/s, s/4)
    elif m[0][0] > m[1][1] and m[0][0] > m[2][2]:
        s = math.sqrt(1 + m[0][0] - m[1][1] - m[2][2]) * 2; q = (s/4, (m[0][1]+m[1][0])/s, (m[0][2]+m[2][0])/s, (m[2][1]-m[1][2])/s)
    elif m[1][1] > m[2][2]:
        s = math.sqrt(1 + m[1][1] - m[0][0] - m[2][2]) * 2; q = ((m[0][1]+m[1][0])/s, s/4, (m[1][2]+m[2][1])/s, (m[0][2]-m[2][0])/s)
    else:
        s = math.sqrt(1 + m[2][2] - m[0][0] - m[1][1]) * 2; q = ((m[0][2]+m[2][0])/s, (m[1][2]+m[2][1])/s, s/4, (m[1][0]-m[0][1])/s)
    return list(q)

WHITE, RED, GREEN = (0.725, 0.71, 0.68), (0.63, 0.065, 0.05), (0.14, 0.45, 0.091)

def cornell_room(g, light=(17.0, 12.0, 4.0)):
    w, r, gr = g.material("white", WHITE), g.material("red", RED), g.material("green", GREEN)
    li = g.material("light", (0.0, 0.0, 0.0), light)
    H = 1.0
    g.node("room", mesh=g.mesh("room", [
        (w, *quads([[(-H,0,H),(H,0,H),(H,0,-H),(-H,0,-H)], [(-H,2,-H),(H,2,-H),(H,2,H),(-H,2,H)], [(-H,0,-H),(H,0,-H),(H,2,-H),(-H,2,-H)]])),
        (r, *quads([[(-H,0,H),(-H,0,-H),(-H,2,-H),(-H,2,H)]])),
        (gr, *quads([[(H,0,-H),(H,0,H),(H,2,H),(H,2,-H)]]))]))
    a = 0.25
    g.node("lamp", mesh=g.mesh("lamp", lamp(g, li, [[(-a,1.98,-a),(a,1.98,-a),(a,1.98,a),(-a,1.98,a)]])))
    return w

def q_y(deg):
    h = math.radians(deg) / 2; return [0.0, math.sin(h), 0.0, math.cos(h)]

def cornell(path, step=None):
    """step: frames (at 24/s) between the five keys of the blocks' motion; None: nothing moves."""
    g = Glb(); w = cornell_room(g)
    tall = g.mesh("tall box", [(w, *quads(box((-0.3, 0, -0.3), (0.3, 1.2, 0.3))))])
    short = g.mesh("short box", [(w, *quads(box((-0.3, 0, -0.3), (0.3, 0.6, 0.3))))])
    n_tall = g.node("tall box", mesh=tall, translation=[-0.35, 0, -0.3], rotation=q_y(18))
    n_short = g.node("short box", mesh=short, translation=[0.35, 0, 0.35], rotation=q_y(-17))
    g.camera("camera", 2 * math.atan(1 / 2.9), 1.0, translation=[0, 1, 3.9])
    if step:  # the short box slides, the tall box turns
        t = [i * step / 24 for i in range(5)]
        g.animation("move", [
            (n_short, "translation", t, [[0.35,0,0.35],[0.1,0,0.55],[-0.35,0,0.6],[-0.1,0,0.4],[0.35,0,0.35]], "LINEAR"),
            (n_tall, "rotation", t, [q_y(18), q_y(63), q_y(108), q_y(153), q_y(198)], "LINEAR")])
    g.write(path)

def furnace(path):
    """Closed box and a sphere in it, albedo 0.5, emission 0.5: radiance is 1 everywhere."""
    g = Glb(); m = g.material("furnace", (0.5, 0.5, 0.5), (0.5, 0.5, 0.5))
    g.node("box", mesh=g.mesh("box", [(m, *quads(box((-1, -1, -1), (1, 1, 1), True)))]))
    g.node("ball", mesh=g.mesh("ball", [(m, *sphere((0.2, -0.3, -0.1), 0.35, 24))]))
    g.camera("camera", math.radians(70), 1.0, translation=[0, 0, 0.9])
    g.write(path)

def integrating_sphere(path):
    """Sphere of radius 1 and albedo 0.8 with a small square lamp at its centre that faces up.
    Lamp: 0.1 m x 0.1 m, radiance 100, one-sided, black. Flux = 100*pi*0.01 = pi W. Away from the lamp's own shadow the
    indirect irradiance is close to 0.8/(1-0.8) * pi/(4*pi) = 1 (the lamp's back blocks a little)."""
    g = Glb(); m = g.material("wall", (0.8, 0.8, 0.8)); l = g.material("lamp", (0, 0, 0), (100.0, 100.0, 100.0))
    g.node("sphere", mesh=g.mesh("sphere", [(m, *sphere((0, 0, 0), 1.0, 96, True))]))
    s = 0.05
    g.node("lamp", mesh=g.mesh("lamp", lamp(g, l, [[(-s,0,s),(s,0,s),(s,0,-s),(-s,0,-s)]])))
    g.camera("camera", math.radians(90), 1.0, translation=[0, -0.5, 0.5], rotation=look_at((0,-0.5,0.5), (0,0.2,-1)))
    g.write(path)

def two_rooms(path, thickness=1e-3):
    """A bright and a dark room that share one wall; the dark room has no light and no opening: it must stay black."""
    g = Glb(); w = g.material("white", (0.7, 0.7, 0.7)); l = g.material("lamp", (0, 0, 0), (20.0, 20.0, 20.0))
    h = thickness / 2
    g.node("bright", mesh=g.mesh("bright", [(w, *quads(box((-3, 0, -1.5), (-h, 2.5, 1.5), True)))]))
    g.node("dark", mesh=g.mesh("dark", [(w, *quads(box((h, 0, -1.5), (3, 2.5, 1.5), True)))]))
    g.node("lamp", mesh=g.mesh("lamp", lamp(g, l, [[(-1.8,2.48,-0.3),(-1.2,2.48,-0.3),(-1.2,2.48,0.3),(-1.8,2.48,0.3)]])))
    g.camera("bright camera", math.radians(75), 1.0, translation=[-2.8, 1.4, 1.3], rotation=look_at((-2.8,1.4,1.3), (-0.3,1.0,-0.8)))
    g.camera("dark camera", math.radians(75), 1.0, translation=[2.8, 1.4, 1.3], rotation=look_at((2.8,1.4,1.3), (0.3,1.0,-0.8)))
    g.write(path)

def changing_rooms(path):
    """Two closed rooms side by side, the left lit by a point, the right by a panel. One thing changes in each animation, at
    keys that 24 frames a second meet: the block in the right room goes along and back, the panel steps down, the point dims,
    the block is painted. What happens on the right is not seen on the left."""
    g = Glb()
    w, clay = g.material("white", (0.7, 0.7, 0.7)), g.material("clay", (0.5, 0.5, 0.5))
    glow = g.material("panel", (0, 0, 0), (16.0, 16.0, 16.0))
    g.node("left", mesh=g.mesh("left", [(w, *quads(box((-3, 0, -1.5), (-0.05, 2.5, 1.5), True)))]))
    g.node("right", mesh=g.mesh("right", [(w, *quads(box((0.05, 0, -1.5), (3, 2.5, 1.5), True)))]))
    g.node("panel", mesh=g.mesh("panel", lamp(g, glow, [[(1.2,2.48,-0.3),(1.8,2.48,-0.3),(1.8,2.48,0.3),(1.2,2.48,0.3)]])))
    g.point_light("point", 8.0, translation=[-1.5, 2.2, 0])
    block = g.node("block", mesh=g.mesh("block", [(clay, *quads(box((-0.3, 0.01, -0.3), (0.3, 0.9, 0.3))))]), translation=[0.75, 0, -0.5])
    g.camera("left camera", math.radians(75), 1.0, translation=[-2.8, 1.4, 1.3], rotation=look_at((-2.8,1.4,1.3), (-0.3,1.0,-0.8)))
    g.camera("right camera", math.radians(75), 1.0, translation=[2.8, 1.4, 1.3], rotation=look_at((2.8,1.4,1.3), (0.3,1.0,-0.8)))
    g.animation("slide", [(block, "translation", [0.5, 0.75, 1.0], [[0.75,0,-0.5],[1.5,0,0.25],[0.75,0,-0.5]], "LINEAR")])
    g.animation("step", [(None, "/materials/%d/extensions/KHR_materials_emissive_strength/emissiveStrength" % glow,
                          [0.0, 0.25], [16.0, 4.0], "STEP")])
    g.animation("dim", [(None, "/extensions/KHR_lights_punctual/lights/0/intensity", [0.0, 0.25], [8.0, 2.0], "LINEAR")])
    g.animation("paint", [(None, "/materials/%d/pbrMetallicRoughness/baseColorFactor" % clay,
                           [0.0, 0.25], [[0.5, 0.5, 0.5, 1.0], [0.5, 0.25, 0.125, 1.0]], "LINEAR")])
    g.write(path)

def reed(path):
    """A closed room, lit by a panel, in which nothing moves but a reed: a morph target bends it over and back."""
    g = Glb()
    w, clay = g.material("white", (0.7, 0.7, 0.7)), g.material("clay", (0.5, 0.5, 0.5))
    glow = g.material("panel", (0, 0, 0), (16.0, 16.0, 16.0))
    g.node("room", mesh=g.mesh("room", [(w, *quads(box((-1.5, 0, -1.5), (1.5, 2.5, 1.5), True)))]))
    g.node("panel", mesh=g.mesh("panel", lamp(g, glow, [[(-0.3,2.48,-0.3),(0.3,2.48,-0.3),(0.3,2.48,0.3),(-0.3,2.48,0.3)]])))
    r, h, n = 0.12, 1.4, 8
    faces = [[(x0, h * i / n, z0), (x1, h * i / n, z1), (x1, h * (i + 1) / n, z1), (x0, h * (i + 1) / n, z0)] for i in range(n)
             for x0, z0, x1, z1 in ((-r, r, r, r), (r, r, r, -r), (r, -r, -r, -r), (-r, -r, -r, r))]
    faces.append([(-r, h, r), (r, h, r), (r, h, -r), (-r, h, -r)])
    bent = [[(x + 0.5 * (y / h) ** 2, y - 0.15 * (y / h) ** 2, z) for x, y, z in f] for f in faces]
    reed = g.mesh("reed", [(clay, *quads(faces))])
    g.morph(reed, quads(bent))
    node = g.node("reed", mesh=reed, translation=[-0.3, 0.0, -0.4])
    g.camera("camera", math.radians(75), 1.0, translation=[1.3, 1.4, 1.3], rotation=look_at((1.3,1.4,1.3), (-0.5,0.8,-0.8)))
    g.animation("bend", [(node, "weights", [0.5, 0.75, 1.0], [0.0, 1.0, 0.0], "LINEAR")])
    g.write(path)

def gallery(path, columns=14, ring=20):
    """A long two-bay gallery: columns, arches of blocks, plinths with spheres, coloured hangings, lit by ceiling panels and
    a bright opening at one end. No textures. A camera flies through it in 120 frames at 24/s."""
    g = Glb()
    stone, warm = g.material("stone", (0.62, 0.58, 0.52)), g.material("floor", (0.45, 0.36, 0.28))
    red, blue, gold = g.material("red", (0.55, 0.06, 0.05)), g.material("blue", (0.06, 0.12, 0.45)), g.material("gold", (0.72, 0.5, 0.12))
    panel, sky = g.material("panel", (0, 0, 0), (14.0, 12.5, 10.0)), g.material("opening", (0, 0, 0), (9.0, 11.0, 14.0))
    L, W, H = 24.0, 8.0, 5.0
    g.node("shell", mesh=g.mesh("shell", [
        (stone, *quads([f for k, f in enumerate(box((-W/2, 0, -L/2), (W/2, H, L/2), True)) if k in (0, 2, 3, 4)] +
                       [[(-W/2,0,-L/2),(-1.5,0,-L/2),(-1.5,H,-L/2),(-W/2,H,-L/2)], [(1.5,0,-L/2),(W/2,0,-L/2),(W/2,H,-L/2),(1.5,H,-L/2)],
                        [(-1.5,3.6,-L/2),(1.5,3.6,-L/2),(1.5,H,-L/2),(-1.5,H,-L/2)]])),
        (warm, *quads([box((-W/2, 0, -L/2), (W/2, H, L/2), True)[5]])),
        *lamp(g, sky, [[(-1.5,0,-L/2-0.4),(1.5,0,-L/2-0.4),(1.5,3.6,-L/2-0.4),(-1.5,3.6,-L/2-0.4)]]),
        (stone, *quads([[(-1.5,0,-L/2),(-1.5,0,-L/2-0.4),(-1.5,3.6,-L/2-0.4),(-1.5,3.6,-L/2)], [(1.5,0,-L/2-0.4),(1.5,0,-L/2),(1.5,3.6,-L/2),(1.5,3.6,-L/2-0.4)],
                        [(-1.5,3.6,-L/2),(-1.5,3.6,-L/2-0.4),(1.5,3.6,-L/2-0.4),(1.5,3.6,-L/2)], [(-1.5,0,-L/2),(1.5,0,-L/2),(1.5,0,-L/2-0.4),(-1.5,0,-L/2-0.4)]]))]))
    col_pos, col_nrm, col_tri = [], [], []
    n = ring
    for i in range(n + 1):  # one column, radius 0.28, with a slight waist
        a = 2 * math.pi * i / n
        for k in range(9):
            y = 3.6 * k / 8; r = 0.30 - 0.05 * math.sin(math.pi * k / 8)
            col_pos.append((r * math.cos(a), y, -r * math.sin(a))); col_nrm.append((math.cos(a), 0, -math.sin(a)))
    for i in range(n):
        for k in range(8):
            a, b = i * 9 + k, (i + 1) * 9 + k
            col_tri += [(a, b, b + 1), (a, b + 1, a + 1)]
    cap = quads(box((-0.42, 3.6, -0.42), (0.42, 3.85, 0.42)) + box((-0.42, 0, -0.42), (0.42, 0.18, 0.42)))
    column = g.mesh("column", [(stone, col_pos, col_nrm, col_tri), (stone, *cap)])
    per = columns // 2
    zs = [-L/2 + L * (i + 0.5) / per for i in range(per)]
    for i, z in enumerate(zs):
        for s, side in ((-1, "left"), (1, "right")):
            g.node("column %s %d" % (side, i), mesh=column, translation=[2.2 * s, 0, z])
    beams = []
    for s in (-1, 1):  # stepped arches between the columns
        for i in range(per - 1):
            z0, z1 = zs[i] + 0.42, zs[i + 1] - 0.42; m = 12
            for k in range(m):
                u0, u1 = k / m, (k + 1) / m; um = (u0 + u1) / 2
                top, y = 4.75, 3.85 + 0.75 * math.sin(math.pi * um)
                beams += box((2.2*s-0.25, y, z0 + (z1-z0)*u0), (2.2*s+0.25, top, z0 + (z1-z0)*u1))
    g.node("arches", mesh=g.mesh("arches", [(stone, *quads(beams))]))
    ball = g.mesh("ball", [(gold, *sphere((0, 0, 0), 0.4, 32))])
    plinth = g.mesh("plinth", [(stone, *quads(box((-0.35, 0, -0.35), (0.35, 0.9, 0.35))))])
    cloth = {}
    for name, mat in (("red", red), ("blue", blue)):
        m, strips = 24, []
        for k in range(m):
            x0, x1 = -0.8 + 1.6 * k / m, -0.8 + 1.6 * (k + 1) / m
            f = lambda x: 0.06 * math.sin(12 * x)
            strips += [[(x0, 1.2, f(x0)), (x1, 1.2, f(x1)), (x1, 3.4, f(x1)), (x0, 3.4, f(x0))],
                       [(x1, 1.2, f(x1)-0.01), (x0, 1.2, f(x0)-0.01), (x0, 3.4, f(x0)-0.01), (x1, 3.4, f(x1)-0.01)]]
        cloth[name] = g.mesh("cloth " + name, [(mat, *quads(strips))])
    for i in range(per - 1):
        z = (zs[i] + zs[i + 1]) / 2
        s = -1 if i % 2 else 1
        g.node("plinth %d" % i, mesh=plinth, translation=[3.1 * s, 0, z])
        g.node("ball %d" % i, mesh=ball, translation=[3.1 * s, 1.3, z])
        g.node("hanging %d" % i, mesh=cloth["red" if i % 2 else "blue"], translation=[-3.85 * s, 0, z], rotation=q_y(90 * s))
    lamps = []
    for z in zs[1::2]:
        lamps.append([(-0.6, H-0.02, z-0.6), (0.6, H-0.02, z-0.6), (0.6, H-0.02, z+0.6), (-0.6, H-0.02, z+0.6)])
    g.node("panels", mesh=g.mesh("panels", lamp(g, panel, lamps)))
    frames = 120
    eye = lambda u: (1.2 * math.sin(2.2 * math.pi * u), 1.65 + 0.35 * math.sin(math.pi * u), 10.5 - 19.0 * u)
    aim = lambda u: (2.4 * math.sin(2.6 * math.pi * u + 0.6), 1.7, 10.5 - 19.0 * u - 4.0)
    times = [i / 24 for i in range(frames + 1)]
    us = [i / frames for i in range(frames + 1)]
    cam = g.camera("fly", math.radians(52), 16 / 9, translation=list(eye(0)), rotation=look_at(eye(0), aim(0)))
    rot = [look_at(eye(u), aim(u)) for u in us]
    for k in range(1, len(rot)):  # shortest way round
        if sum(a * b for a, b in zip(rot[k - 1], rot[k])) < 0:
            rot[k] = [-a for a in rot[k]]
    g.animation("fly", [(cam, "translation", times, [list(eye(u)) for u in us], "LINEAR"), (cam, "rotation", times, rot, "LINEAR")])
    g.camera("still", math.radians(52), 16 / 9, translation=[-1.0, 1.7, 9.5], rotation=look_at((-1.0, 1.7, 9.5), (1.6, 1.5, 0)))
    g.write(path)

def exhibition(path):
    """A hall of 100 objects, each with a material of its own: a shell, partitions with passages between six bays, panels of light
    in each, plinths with blocks on them, pictures on the walls. Cameras: one along the hall, one at an exhibit."""
    g = Glb()
    count = 0
    L, W, H, bays = 24.0, 10.0, 4.0, 6
    hue = lambda i: tuple(0.25 + 0.45 * (0.5 + 0.5 * math.sin(2.4 * i + k * 2.1)) for k in range(3))
    def add(name, faces, color, at=(0, 0, 0)):
        nonlocal count
        m = g.material(name, color)
        g.node(name, mesh=g.mesh(name, [(m, *quads(faces))]), translation=list(at))
        count += 1
    shell = box((-W/2, 0, -L/2), (W/2, H, L/2), True)
    for name, face in zip(("south", "north", "east", "west", "ceiling", "floor"), shell):
        add(name, [face], (0.4, 0.36, 0.32) if name == "floor" else (0.65, 0.63, 0.6))
    step = L / bays
    for i in range(1, bays):  # two halves of a wall, a passage of 2.4 m between them
        z = -L/2 + i * step
        add("partition left %d" % i, box((-W/2 + 0.02, 0.01, z - 0.1), (-1.2, H - 0.01, z + 0.1)), (0.6, 0.6, 0.62))
        add("partition right %d" % i, box((1.2, 0.01, z - 0.1), (W/2 - 0.02, H - 0.01, z + 0.1)), (0.6, 0.6, 0.62))
    light = g.material("panel", (0.0, 0.0, 0.0), (14.0, 13.0, 11.0))
    for i in range(bays):
        z = -L/2 + (i + 0.5) * step
        g.node("panel %d" % i, mesh=g.mesh("panel %d" % i, lamp(g, light, [
            [(-0.8, H-0.02, z-0.8), (0.8, H-0.02, z-0.8), (0.8, H-0.02, z+0.8), (-0.8, H-0.02, z+0.8)]])))
        count += 1
        for k, x in enumerate((-3.6, -2.2, 2.2, 3.6)):
            n = 4 * i + k
            add("plinth %d" % n, box((-0.25, 0.005, -0.25), (0.25, 0.9, 0.25)), (0.6, 0.58, 0.55), (x, 0, z))
            add("exhibit %d" % n, box((-0.2, 0.91, -0.2), (0.2, 1.0 + 0.1 * (n % 4), 0.2)), hue(n), (x, 0, z))
        for k, s in enumerate((-1, 1)):
            n = 2 * i + k
            x = s * (W/2 - 0.03)
            for row in range(2):
                add("picture %d.%d" % (n, row), box((x - 0.02, 1.2 + 1.1 * row, z - 0.5), (x + 0.02, 2.1 + 1.1 * row, z + 0.5)), hue(50 + 2 * n + row))
    while count < 100:
        add("bench %d" % count, box((-0.5, 0.005, -0.2), (0.5, 0.45, 0.2)), hue(count), (0, 0, -L/2 + (count - 93.5) * step))
    assert count == 100
    g.camera("hall", math.radians(60), 16 / 9, translation=[0, 1.7, L/2 - 0.5], rotation=look_at((0, 1.7, L/2 - 0.5), (0, 1.4, 0)))
    g.camera("exhibit", math.radians(50), 16 / 9, translation=[-0.9, 1.6, 2.6], rotation=look_at((-0.9, 1.6, 2.6), (-3.6, 1.0, 2.0)))
    g.write(path)

def prism(sides, radius, lo, hi):
    """Upright prism as flat-shaded quads, with a lid."""
    at = lambda i, y: (radius * math.cos(2 * math.pi * i / sides), y, -radius * math.sin(2 * math.pi * i / sides))
    faces = [[at(i, lo), at(i + 1, lo), at(i + 1, hi), at(i, hi)] for i in range(sides)]
    return faces + [[(0, hi, 0), at(i, hi), at(i + 0.5, hi), at(i + 1, hi)] for i in range(sides)]

def torus(major, minor, n=48, m=24):
    pos, nrm, tri = [], [], []
    for i in range(n + 1):
        a = 2 * math.pi * i / n
        for j in range(m + 1):
            b = 2 * math.pi * j / m
            d = (math.cos(a) * math.cos(b), math.sin(b), -math.sin(a) * math.cos(b))
            pos.append((major * math.cos(a) + minor * d[0], minor * d[1], -major * math.sin(a) + minor * d[2])); nrm.append(d)
    for i in range(n):
        for j in range(m):
            a, b = i * (m + 1) + j, (i + 1) * (m + 1) + j
            tri += [(a, b, b + 1), (a, b + 1, a + 1)]
    return pos, nrm, tri

def still_life(path):
    """Objects on a round table under a glowing ball, open to the sky, without a camera: for turntables."""
    g = Glb()
    table = g.material("table", (0.58, 0.55, 0.5)); clay = g.material("clay", (0.66, 0.22, 0.12)); teal = g.material("teal", (0.08, 0.36, 0.36))
    ivory = g.material("ivory", (0.78, 0.74, 0.64), roughness=0.35, lambert=False)
    brass = g.material("brass", (0.85, 0.62, 0.25), roughness=0.3, metallic=1.0, lambert=False)
    lamp_mat = g.material("lamp", (0, 0, 0), (26.0, 22.0, 17.0))
    g.node("table", mesh=g.mesh("table", [(table, *quads(prism(64, 1.15, -0.1, 0.0)))]))
    g.node("ball", mesh=g.mesh("ball", [(ivory, *sphere((0, 0, 0), 0.34, 40))]), translation=[0.05, 0.34, 0.1])
    g.node("ring", mesh=g.mesh("ring", [(brass, *torus(0.26, 0.08))]), translation=[-0.72, 0.08, 0.28])
    g.node("block", mesh=g.mesh("block", [(clay, *quads(box((-0.22, 0, -0.22), (0.22, 0.8, 0.22))))]), translation=[0.62, 0, -0.35], rotation=q_y(24))
    g.node("column", mesh=g.mesh("column", [(teal, *quads(prism(6, 0.26, 0.0, 0.55)))]), translation=[-0.45, 0, -0.55])
    g.node("bead", mesh=g.mesh("bead", [(teal, *sphere((0, 0, 0), 0.15, 24))]), translation=[0.55, 0.15, 0.55])
    g.node("lamp", mesh=g.mesh("lamp", [(lamp_mat, *sphere((0, 0, 0), 0.11, 8))]), translation=[-0.35, 1.15, 0.3])
    g.write(path)

def sky(path, width=128, height=64):
    """Lat-long OpenEXR, scan lines of float without compression: a blue gradient, a warm patch, dark ground."""
    def attribute(name, kind, data):
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data
    channels = b"".join(c + b"\0" + struct.pack("<iBxxxii", 2, 0, 1, 1) for c in (b"B", b"G", b"R")) + b"\0"
    window = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    header = struct.pack("<II", 20000630, 2) + b"".join([
        attribute("channels", "chlist", channels), attribute("compression", "compression", b"\0"),
        attribute("dataWindow", "box2i", window), attribute("displayWindow", "box2i", window),
        attribute("lineOrder", "lineOrder", b"\0"), attribute("pixelAspectRatio", "float", struct.pack("<f", 1.0)),
        attribute("screenWindowCenter", "v2f", struct.pack("<ff", 0, 0)), attribute("screenWindowWidth", "float", struct.pack("<f", 1.0))]) + b"\0"
    def texel(x, y):
        up = math.cos(math.pi * (y + 0.5) / height)  # 1 at the zenith
        around = math.cos(2 * math.pi * ((x + 0.5) / width - 0.7))  # 1 towards the warm patch
        glow = math.exp(5.0 * (around - 1) - 8.0 * (up - 0.35) ** 2)
        day = 1 / (1 + math.exp(-12 * up))  # a soft horizon
        base = [g + (b - g) * day for g, b in zip((0.12, 0.1, 0.09), (0.3, 0.42, 0.6))]
        return [b * (1.0 + 0.5 * abs(up)) + g * glow for b, g in zip(base, (3.0, 2.2, 1.4))]
    size = 12 * width
    start = len(header) + 8 * height
    with open(path, "wb") as f:
        f.write(header + b"".join(struct.pack("<Q", start + y * (size + 8)) for y in range(height)))
        for y in range(height):
            row = [texel(x, y) for x in range(width)]
            f.write(struct.pack("<ii", y, size) + b"".join(struct.pack("<%df" % width, *(t[c] for t in row)) for c in (2, 1, 0)))

def text(path, content):
    with open(path, "w", newline="\n") as f:
        f.write(content)

SCENES = {
    "cornell.glb": cornell,
    "cornell-moving.glb": lambda p: cornell(p, 12),
    "cornell-fast.glb": lambda p: cornell(p, 3),
    "furnace.glb": furnace,
    "integrating-sphere.glb": integrating_sphere,
    "two-rooms.glb": two_rooms,
    "two-rooms-thin.glb": lambda p: two_rooms(p, 1e-5),
    "changing-rooms.glb": changing_rooms,
    "reed.glb": reed,
    "gallery.glb": gallery,
    "exhibition.glb": exhibition,
    "still-life.glb": still_life,
    "sky.exr": sky,
    "path.json": lambda p: text(p, json.dumps({"keys": [
        {"frame": 1, "eye": [0, 1, 3.9], "target": [0, 1, 0]}, {"frame": 4, "eye": [0.4, 1.2, 3.5], "target": [0, 1, 0]}]})),
    "broken.glb": lambda p: text(p, "glTF, or so it says"),
}

def main():
    out = sys.argv[1]
    os.makedirs(out, exist_ok=True)
    for name in sys.argv[2:] or SCENES:
        SCENES[name](os.path.join(out, name))

if __name__ == "__main__":
    main()
