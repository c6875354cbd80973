"""A recorded flame lights a room: the paper's Fig. 9, by Cycles on the processor.

    pyrovox convert --split RECORDING FLAME --format vdb
    blender --background --python room.py -- FLAME --out room.png [--frame N] [--samples N] [--size WxH]

FLAME: a folder of .vdb files, or one.  The room is built around the flame, in its size.  Light is the flame's alone: what
the camera and what is polished sees is the volume itself; what is matt is lit by 64 lamps that share out its emission,
since Cycles finds a volume's light only by chance.
"""
import argparse
import math
import os
import re
import sys

import bpy
import numpy as np
from mathutils import Vector

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from pyrovox_blender import flame, vdb  # noqa: E402

LAMPS = 64
COLOURS = ("red", "green", "blue")


def wrong(text):
    print(f"room.py: {text}", file=sys.stderr, flush=True)
    sys.exit(1)


def options():
    words = sys.argv[sys.argv.index("--") + 1:] if "--" in sys.argv else []
    p = argparse.ArgumentParser(prog="blender --background --python room.py --", description="A recorded flame lights a room, rendered by Cycles.")
    p.add_argument("flame", help="a folder of .vdb files as pyrovox convert --split makes it, or one of them")
    p.add_argument("--out", default="room.png", metavar="PNG", help="the picture (%(default)s)")
    p.add_argument("--frame", type=int, default=1, metavar="N", help="which file of the folder, from 1 (%(default)s)")
    p.add_argument("--samples", type=int, default=128, metavar="N", help="paths a pixel; noise falls with its root (%(default)s)")
    p.add_argument("--size", default="960x640", metavar="WxH", help="pixels (%(default)s)")
    p.add_argument("--exposure", type=float, default=6.2, metavar="STOPS", help="how bright the picture is; the flame is some hundred times as bright as what it lights (%(default)s)")
    p.add_argument("--hold-back", type=float, default=3.5, metavar="STOPS", help="the flame itself is seen so much darker than it is, for one picture to hold both; 0: as it is (%(default)s)")
    p.add_argument("--no-lamps", action="store_true", help="matt things are lit by the volume too: exact, and takes a hundred times the samples")
    p.add_argument("--save", metavar="BLEND", help="the scene too, to go on from")
    a = p.parse_args(words)
    try:
        a.width, a.height = (int(n) for n in a.size.split("x"))
    except ValueError:
        p.error(f"--size {a.size}: should be as 960x640")
    if not (16 <= a.width <= 16384 and 16 <= a.height <= 16384 and 1 <= a.samples <= 1 << 20):
        p.error("a size of 16 to 16384 pixels, 1 to 1048576 samples")
    return a


# ---- the flame ----------------------------------------------------------------------------------


def chosen(path, number):
    if os.path.isfile(path):
        return path
    if not os.path.isdir(path):
        wrong(f"{path}: is not there")
    files = sorted((n for n in os.listdir(path) if n.endswith(".vdb") and not n.startswith(".")),
                   key=lambda n: [int(k) if k.isdigit() else k for k in re.split(r"(\d+)", n)])
    if not files:
        wrong(f"{path}: has no .vdb files; make them: pyrovox convert --split {path} FLAME --format vdb")
    if not 1 <= number <= len(files):
        wrong(f"--frame {number}: {path} has 1 to {len(files)}")
    return os.path.join(path, files[number - 1])


def load(library, path):
    """Values [x][y][z][3] of the box that is lit, its corner, and a voxel's sides, m."""
    try:
        grids = {g.name: g for g in library.readAll(path)[0]}
    except (OSError, RuntimeError) as e:
        wrong(f"{path}: cannot be read: {e}")
    names = COLOURS if set(COLOURS) <= set(grids) else ("density",)
    if names[0] not in grids or (names == ("density",) and "emission" in grids):
        wrong(f"{path}: has no grids red, green, blue: make it with pyrovox convert --split")
    if all(grids[n].empty() for n in names):
        wrong(f"{path}: there is no flame in it; another --frame?")
    low, high = np.array(grids["density"].evalActiveVoxelBoundingBox())
    values = []
    for n in names:
        a = np.zeros(high - low + 1, np.float32)
        grids[n].copyToArray(a, tuple(int(i) for i in low))
        values.append(a)
    step = np.array(grids["density"].transform.voxelSize())
    corner = np.array(grids["density"].transform.indexToWorld(tuple(int(i) for i in low))) - step / 2
    return np.stack(values * (3 // len(values)), -1).astype(float), corner, step, len(names)


def shares(values, corner, step, n):
    """n boxes of equal light: power by colour, the middle of it, and how far it spreads, m."""
    i = np.argwhere(values.sum(-1) > 0)
    e = values[tuple(i.T)]
    p = corner + (i + 0.5) * step
    parts = [np.arange(len(i))]
    while len(parts) < n:
        halves = []
        for part in parts:
            axis = int(np.argmax(np.ptp(p[part], axis=0))) if len(part) else 0
            part = part[np.argsort(p[part, axis], kind="stable")]
            light = np.cumsum(e[part].sum(1))
            cut = int(np.searchsorted(light, light[-1] / 2)) + 1 if len(part) else 0
            halves += [part[:cut], part[cut:]]
        parts = halves
    for part in parts:
        if len(part):
            w = e[part].sum(1)
            at = (p[part] * w[:, None]).sum(0) / w.sum()
            yield e[part].sum(0) * step.prod(), at, math.sqrt((((p[part] - at) ** 2).sum(1) * w).sum() / w.sum())


def lamps(values, corner, step):
    """A voxel's radiant intensity is emission times volume; a lamp's is its power over 4 pi."""
    for k, (light, at, spread) in enumerate(shares(values, corner, step, LAMPS)):
        lamp = bpy.data.lights.new(f"share {k}", "POINT")
        power = 4 * math.pi * light
        lamp.energy = float(power.max())
        lamp.color = [float(x) for x in power / power.max()]
        lamp.shadow_soft_size = spread
        o = bpy.data.objects.new(lamp.name, lamp)
        o.location = at
        o.visible_camera = o.visible_glossy = o.visible_transmission = False
        bpy.context.scene.collection.objects.link(o)


def hold_back(material, stops):
    """What the camera itself sees of the flame, and nobody else."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    emission = next(n for n in nodes if n.type == "EMISSION")
    path, factor = nodes.new("ShaderNodeLightPath"), nodes.new("ShaderNodeMapRange")
    factor.inputs["To Min"].default_value, factor.inputs["To Max"].default_value = 1, 2 ** -stops
    links.new(path.outputs["Is Camera Ray"], factor.inputs["Value"])
    links.new(factor.outputs["Result"], emission.inputs["Strength"])


# ---- matter -------------------------------------------------------------------------------------


def matter(name, rough, colour=(0.5, 0.5, 0.5), metal=0.0, pattern=None, scale=1.0, dark=(0.1, 0.1, 0.1), bump=0.3):
    """A Principled surface: plain, or with a pattern of two colours that is felt too."""
    m = bpy.data.materials.new(name)
    m.use_nodes = True
    nodes, links = m.node_tree.nodes, m.node_tree.links
    p = nodes["Principled BSDF"]
    p.inputs["Base Color"].default_value, p.inputs["Roughness"].default_value, p.inputs["Metallic"].default_value = (*colour, 1), rough, metal
    if rough > 0.6:
        p.inputs["Specular IOR Level" if "Specular IOR Level" in p.inputs else "Specular"].default_value = 0  # would find the flame by chance alone
    if pattern is None:
        return m
    at = nodes.new("ShaderNodeTexCoord")
    place = nodes.new("ShaderNodeMapping")
    place.inputs["Scale"].default_value = (scale, scale, scale)
    links.new(at.outputs["Generated" if pattern == "grain" else "Object"], place.inputs["Vector"])
    noise = nodes.new("ShaderNodeTexNoise")
    noise.inputs["Scale"].default_value, noise.inputs["Detail"].default_value = 4, 8
    links.new(place.outputs["Vector"], noise.inputs["Vector"])
    mix = nodes.new("ShaderNodeMixRGB")
    mix.inputs["Color1"].default_value, mix.inputs["Color2"].default_value = (*colour, 1), (*dark, 1)
    height = noise.outputs["Fac"]
    if pattern == "grain":  # wood: noise drawn out along one way
        place.inputs["Scale"].default_value = (scale * 12, scale * 12, scale)
        links.new(noise.outputs["Fac"], mix.inputs["Fac"])
    elif pattern == "bricks":
        brick = nodes.new("ShaderNodeTexBrick")
        for key, value in (("Scale", 1.0), ("Mortar Size", 0.012), ("Mortar Smooth", 0.3), ("Brick Width", 0.36), ("Row Height", 0.12), ("Bias", 0.0)):
            brick.inputs[key].default_value = value
        brick.inputs["Color1"].default_value = (*colour, 1)
        brick.inputs["Color2"].default_value = (*(0.6 * c for c in colour), 1)
        brick.inputs["Mortar"].default_value = (*dark, 1)
        links.new(place.outputs["Vector"], brick.inputs["Vector"])
        links.new(brick.outputs["Color"], mix.inputs["Color1"])
        fade = nodes.new("ShaderNodeMath")
        fade.operation, fade.inputs[1].default_value = "MULTIPLY", 0.5
        links.new(noise.outputs["Fac"], fade.inputs[0])
        links.new(fade.outputs[0], mix.inputs["Fac"])
        sink = nodes.new("ShaderNodeMath")
        sink.operation = "SUBTRACT"
        links.new(noise.outputs["Fac"], sink.inputs[0])
        links.new(brick.outputs["Fac"], sink.inputs[1])
        height = sink.outputs[0]
    else:  # stone
        links.new(noise.outputs["Fac"], mix.inputs["Fac"])
    felt = nodes.new("ShaderNodeBump")
    felt.inputs["Strength"].default_value, felt.inputs["Distance"].default_value = bump, 0.02
    links.new(height, felt.inputs["Height"])
    links.new(mix.outputs["Color"], p.inputs["Base Color"])
    links.new(felt.outputs["Normal"], p.inputs["Normal"])
    return m


def thing(name, points, faces, material, at=(0, 0, 0), turn=(0, 0, 0), smooth=False, round_edges=0.0):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    mesh.materials.append(material)
    for f in mesh.polygons:
        f.use_smooth = smooth
    o = bpy.data.objects.new(name, mesh)
    o.location, o.rotation_euler = at, turn
    bpy.context.scene.collection.objects.link(o)
    if round_edges:
        b = o.modifiers.new("edges", "BEVEL")
        b.width, b.segments = round_edges, 3
    return o


def box(name, size, material, at, turn=0.0, round_edges=0.008):
    x, y, z = (s / 2 for s in size)
    points = [(i, j, k) for k in (-z, z) for j in (-y, y) for i in (-x, x)]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return thing(name, points, faces, material, at, (0, 0, turn) if isinstance(turn, (int, float)) else turn, round_edges=round_edges)


def turned(name, profile, material, at=(0, 0, 0), n=96, turn=(0, 0, 0), flutes=0):
    """A lathe's work: profile of (radius, height); flutes: grooves along it where the radius is that of the shaft."""
    shaft = profile[len(profile) // 2][0]
    points, faces = [], []
    for r, z in profile:
        for k in range(n):
            a = 2 * math.pi * k / n
            groove = 0.06 * shaft * abs(math.sin(flutes * a / 2)) if flutes and abs(r - shaft) < 0.12 * shaft else 0
            points.append(((r - groove) * math.cos(a), (r - groove) * math.sin(a), z))
    for i in range(len(profile) - 1):
        for k in range(n):
            a, b = i * n + k, i * n + (k + 1) % n
            faces.append((a, b, b + n, a + n))
    return thing(name, points, faces, material, at, turn, smooth=True)


def wall(name, a, b, c, d, material):
    return thing(name, [a, b, c, d], [(0, 1, 2, 3)], material)


def room(u, floor, x0, y0):
    """Everything but the flame, whose foot is (x0, y0), 0.42 u above the floor."""
    before = set(bpy.data.objects)
    bricks = matter("bricks", 0.85, (0.46, 0.33, 0.25), pattern="bricks", scale=1, dark=(0.36, 0.32, 0.28), bump=0.5)
    flags = matter("flags", 0.38, (0.34, 0.31, 0.28), pattern="bricks", scale=0.3, dark=(0.05, 0.045, 0.04), bump=0.25)
    stone = matter("stone", 0.8, (0.50, 0.45, 0.38), pattern="stone", scale=1.5, dark=(0.34, 0.29, 0.23), bump=0.35)
    iron = matter("iron", 0.45, (0.12, 0.11, 0.10), 1.0, pattern="stone", scale=4, dark=(0.06, 0.05, 0.045), bump=0.2)
    wood = matter("wood", 0.65, (0.36, 0.19, 0.085), pattern="grain", scale=1.2, dark=(0.16, 0.075, 0.03), bump=0.2)
    clay = matter("clay", 0.65, (0.44, 0.19, 0.10), pattern="stone", scale=3, dark=(0.33, 0.13, 0.06), bump=0.1)
    copper = matter("copper", 0.16, (0.93, 0.55, 0.38), 1.0)
    plaster = matter("ceiling", 0.9, (0.34, 0.28, 0.22), pattern="stone", scale=0.8, dark=(0.25, 0.2, 0.15), bump=0.2)
    w, front, back, high = 1.9, -4.2, 1.55, 2.7
    wall("floor", (-w, front, 0), (w, front, 0), (w, back, 0), (-w, back, 0), flags)
    wall("ceiling", (-w, front, high), (-w, back, high), (w, back, high), (w, front, high), plaster)
    # walls lie flat in their own space, where the pattern is
    for name, length, at, turn in (("back", 2 * w, (-w, back, 0), 0), ("front", 2 * w, (w, front, 0), math.pi), ("left", back - front, (-w, front, 0), math.pi / 2), ("right", back - front, (w, back, 0), -math.pi / 2)):
        thing(name, [(0, 0, 0), (length, 0, 0), (length, high, 0), (0, high, 0)], [(0, 1, 2, 3)], bricks, at, (math.pi / 2, 0, turn))
    for k in range(4):  # beams
        box(f"beam {k}", (2 * w, 0.16, 0.2), wood, (0, back - 0.45 - 1.15 * k, high - 0.1), 0, 0.012)
    # the bowl on its pedestal, under the flame
    turned("pedestal", [(0, 0), (0.30, 0), (0.30, 0.06), (0.25, 0.075), (0.25, 0.27), (0.29, 0.285), (0.29, 0.33), (0, 0.33)], stone)
    turned("bowl", [(0, 0.335), (0.10, 0.335), (0.12, 0.345), (0.22, 0.375), (0.285, 0.44), (0.30, 0.455), (0.29, 0.46), (0.27, 0.445), (0.2, 0.395), (0, 0.375)], iron)
    # the pillar between
    shaft = [(0.150, 0.22 + 0.1 * k) for k in range(21)]
    turned("pillar", [(0, 0), (0.23, 0), (0.23, 0.07), (0.21, 0.08), (0.215, 0.12), (0.19, 0.15), (0.175, 0.16), (0.158, 0.2), *shaft, (0.158, 2.26), (0.2, 2.31),
                      (0.2, 2.34), (0.235, 2.40), (0.235, 2.47), (0, 2.47)], stone, (0.155, -1.15, 0), n=160, flutes=16)
    box("plinth", (0.52, 0.52, 0.05), stone, (0.155, -1.15, 0.0), 0, 0.01)
    box("abacus", (0.56, 0.56, 0.23), stone, (0.155, -1.15, high - 0.115), 0, 0.01)
    # crates, jars, firewood, a ladder, a copper ball
    for name, size, at, turn in (("crate a", 0.52, (-1.35, 0.75, 0.26), 0.22), ("crate b", 0.46, (-1.38, 0.12, 0.23), -0.15), ("crate c", 0.40, (-1.33, 0.72, 0.72), -0.3)):
        box(name, (size - 0.03,) * 3, wood, at, turn)
        c, s = math.cos(turn), math.sin(turn)
        for i in (-1, 1):
            for j in (-1, 1):
                dx, dy = i * (size / 2 - 0.025), j * (size / 2 - 0.025)
                box(f"{name} post", (0.07, 0.07, size), wood, (at[0] + c * dx - s * dy, at[1] + s * dx + c * dy, at[2]), turn, 0.006)
                box(f"{name} bar", (size, 0.035, 0.07), wood, (at[0] - s * i * (size / 2), at[1] + c * i * (size / 2), at[2] + j * (size / 2 - 0.035)), turn, 0.006)
                box(f"{name} side", (0.035, size, 0.07), wood, (at[0] + c * i * (size / 2), at[1] + s * i * (size / 2), at[2] + j * (size / 2 - 0.035)), turn, 0.006)
    jar = [(0, 0), (0.10, 0), (0.11, 0.02), (0.17, 0.14), (0.205, 0.28), (0.20, 0.40), (0.15, 0.52), (0.085, 0.59), (0.075, 0.66), (0.105, 0.70), (0.10, 0.71), (0.06, 0.66), (0.06, 0.5), (0, 0.45)]
    turned("jar", jar, clay, (1.28, 0.72, 0))
    turned("small jar", [(0.7 * r, 0.62 * z) for r, z in jar], clay, (0.98, 0.28, 0))
    turned("bowl on the floor", [(0, 0.012), (0.07, 0), (0.08, 0.01), (0.15, 0.06), (0.165, 0.10), (0.155, 0.10), (0.07, 0.03), (0, 0.025)], clay, (1.18, -0.28, 0))
    for k, (x, y, z, a) in enumerate(((-0.72, -0.25, 0.055, 0.5), (-0.80, -0.38, 0.055, 0.42), (-0.66, -0.12, 0.055, 0.62), (-0.76, -0.31, 0.15, 0.36), (-0.70, -0.19, 0.15, 0.66))):
        turned(f"log {k}", [(0, -0.24), (0.05, -0.24), (0.055, -0.2), (0.052, 0), (0.056, 0.2), (0.05, 0.24), (0, 0.24)], wood, (x, y, z), 24, (0, math.pi / 2, a))
    lean = 0.22
    for x in (0.62, 1.0):
        box("rail", (0.05, 0.05, 2.3), wood, (x, 1.26, 1.12), (-lean, 0, 0), 0.008)
    for k in range(7):
        z = 0.3 + 0.29 * k
        turned(f"rung {k}", [(0, -0.19), (0.016, -0.19), (0.016, 0), (0.016, 0.19), (0, 0.19)], wood, (0.81, 1.26 + (z - 1.12) * math.tan(lean), z), 16, (0, math.pi / 2, 0))
    ball = [(0.15 * math.sin(math.pi * k / 48), 0.15 - 0.15 * math.cos(math.pi * k / 48)) for k in range(49)]
    turned("ball", ball, copper, (-0.62, -1.02, 0))
    for o in set(bpy.data.objects) - before:
        o.location = Vector((x0, y0, floor)) + u * o.location
        o.scale = (u, u, u)


def picture(a, u, floor, x0, y0):
    s = bpy.context.scene
    camera = bpy.data.cameras.new("camera")
    o = bpy.data.objects.new("camera", camera)
    s.collection.objects.link(o)
    s.camera = o
    base = Vector((x0, y0, floor))
    eye, at = Vector((-0.28, -3.35, 1.22)), Vector((0.0, 0.0, 0.83))
    o.location = base + u * eye
    o.rotation_euler = (at - eye).to_track_quat("-Z", "Y").to_euler()
    camera.lens, camera.clip_start, camera.clip_end = 29, 0.01 * u, 100 * u
    r, c = s.render, s.cycles
    r.engine, c.device, c.samples, c.use_denoising, c.use_adaptive_sampling, c.seed = "CYCLES", "CPU", a.samples, False, False, 1
    c.max_bounces, c.diffuse_bounces, c.glossy_bounces, c.volume_bounces, c.sample_clamp_indirect = 6, 4, 3, 0, 4 / 2 ** a.exposure
    c.volume_step_rate = 1
    c.caustics_reflective, c.blur_glossy = False, 1.0
    r.resolution_x, r.resolution_y, r.resolution_percentage = a.width, a.height, 100
    r.image_settings.file_format, r.image_settings.color_mode, r.image_settings.compression = "PNG", "RGB", 100
    r.filepath, r.use_file_extension = os.path.abspath(a.out), False
    s.view_settings.view_transform, s.view_settings.exposure = "Standard", a.exposure
    s.view_settings.use_curve_mapping = True
    s.view_settings.curve_mapping.white_level = (1.0, 0.9, 0.74)  # an eye that has been there for a while
    s.world = bpy.data.worlds.new("nothing")
    s.world.color = (0, 0, 0)


def main():
    a = options()
    library = vdb.library()
    if library is None:
        wrong(vdb.MISSING)
    path = os.path.abspath(chosen(a.flame, a.frame))
    values, corner, step, channels = load(library, path)
    folder = os.path.dirname(os.path.abspath(a.out))
    if not os.path.isdir(folder) or not os.access(folder, os.W_OK):
        wrong(f"--out {a.out}: its folder is not there, or cannot be written")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    # the flame's axis, foot and height, by its light
    light = values.sum(-1)
    z = np.cumsum(light.sum((0, 1))) / light.sum()
    foot, top = (corner[2] + np.searchsorted(z, q) * step[2] for q in (0.005, 0.995))
    x0, y0 = (float(corner[i] + (np.arange(light.shape[i]) + 0.5).dot(light.sum(tuple({0, 1, 2} - {i}))) / light.sum() * step[i]) for i in (0, 1))
    u = float(top - foot) / 0.8
    floor = float(foot) - 0.40 * u
    volume = flame.make(flame.BAKED, "Flame")
    volume.filepath = path
    flame.dress(volume, channels, tuple(step))
    hold_back(volume.materials[0], a.hold_back)
    if not a.no_lamps:
        for o in bpy.data.objects:
            o.visible_diffuse = False
        lamps(values, corner, step)
    room(u, floor, x0, y0)
    picture(a, u, floor, x0, y0)
    if a.save:
        bpy.ops.wm.save_as_mainfile(filepath=os.path.abspath(a.save))
    bpy.ops.render.render(write_still=True)
    if not os.path.exists(os.path.abspath(a.out)):
        wrong(f"{a.out}: was not written")
    print(a.out)


main()
