"""What runs in Blender: inside.py -- WHAT FOLDER ZIP [MORE].  blender.py starts it.

A scene with a timer of its own is a generator that yields what it waits for; what it finds goes to FOLDER/found.json.
"""
import json
import math
import os
import sys
import time

import bpy
import numpy as np
from mathutils import Vector

what, folder, zipped, *more = sys.argv[sys.argv.index("--") + 1:]
found = {}


def install():
    bpy.ops.preferences.addon_install(filepath=zipped)
    bpy.ops.preferences.addon_enable(module="pyrovox_blender")


def say():
    with open(f"{folder}/found.part", "w") as f:
        json.dump(found, f)
    os.replace(f"{folder}/found.part", f"{folder}/found.json")


def step(name):
    """The other side did what it was asked for."""
    return lambda: os.path.exists(f"{folder}/did-{name}")


def ask(name):
    open(f"{folder}/do-{name}", "w").close()
    return step(name)


def wrong(call):
    """An operator that has to refuse: its sentence."""
    from pyrovox_blender.follow import live
    live.error = ""
    assert call() == {"CANCELLED"}
    return live.error


# ---- in the background --------------------------------------------------------------------------


def sequence():
    """Files as a sequence: what each frame shows."""
    from pyrovox_blender import flame
    files = sorted(f"{more[0]}/{n}" for n in os.listdir(more[0]) if n.endswith(".vdb"))
    volume, scene, frames = flame.sequence(files, 3, (0.1, 0.1, 0.1), 5), bpy.context.scene, []
    for f in range(4, 5 + len(files) + 1):
        scene.frame_set(f)
        v = next(o for o in bpy.data.objects if o.data == volume).evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        v.grids.load()
        frames.append([f, os.path.basename(v.grids.frame_filepath) if v.grids.is_loaded else "", v.grids.error_message,
                       {g.name: [g.data_type, g.channels, [list(r) for r in g.matrix_object]] for g in v.grids}])
    found["frames"] = frames
    found["volume"] = [volume.is_sequence, volume.frame_start, volume.frame_duration, volume.frame_offset, volume.sequence_mode]
    found["files"] = [os.path.basename(f) for f in files]


def picture():
    """Cycles' picture of each file as linear floats, from the camera of pyrovox render."""
    from pyrovox_blender import flame
    for job in json.loads(more[0]):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        s = bpy.context.scene
        volume = flame.make(flame.LIVE, "Flame")
        volume.filepath = job["vdb"]
        flame.dress(volume, job["channels"], job["spacing"])
        camera = bpy.data.cameras.new("camera")
        o = bpy.data.objects.new("camera", camera)
        s.collection.objects.link(o)
        s.camera = o
        eye, at = Vector(job["eye"]), Vector(job["at"])
        o.location, o.rotation_euler = eye, (at - eye).to_track_quat("-Z", "Y").to_euler()
        camera.sensor_fit, camera.clip_start = "VERTICAL", 0.01
        camera.angle_y = math.radians(job["fov"])
        r, c = s.render, s.cycles
        r.engine, c.device, c.samples, c.use_denoising, c.use_adaptive_sampling, c.pixel_filter_type = "CYCLES", "CPU", 64, False, False, "BOX"
        r.resolution_x, r.resolution_y, r.resolution_percentage = *job["size"], 100
        r.image_settings.file_format, r.image_settings.color_depth, r.filepath = "OPEN_EXR", "32", f"{folder}/picture.exr"
        s.view_settings.view_transform = "Raw"
        bpy.ops.render.render(write_still=True)
        i = bpy.data.images.load(f"{folder}/picture.exr")
        np.save(job["out"], np.array(i.pixels[:], np.float32).reshape(i.size[1], i.size[0], -1)[::-1, :, :3])


def bare():
    """An empty scene; factory settings take the add-on away."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_enable(module="pyrovox_blender")


def scene_of(kind):
    """Cameras of every fit, with shift, and parents that are scaled; pixels that are not square."""
    bare()
    s = bpy.context.scene
    s.unit_settings.scale_length = 0.5
    r = s.render
    r.resolution_x, r.resolution_y, r.resolution_percentage = (800, 600, 80) if kind == 0 else (480, 640, 100)
    r.pixel_aspect_x, r.pixel_aspect_y = (1, 1.25) if kind == 0 else (1.1, 1)
    up = bpy.data.objects.new("up", None)
    s.collection.objects.link(up)
    up.scale, up.location = (2, 2, 2), (0.5, 0.25, 0)
    for i, fit in enumerate(("AUTO", "HORIZONTAL", "VERTICAL")):
        c = bpy.data.cameras.new(f"cam {fit}")
        c.sensor_fit, c.lens, c.sensor_width, c.sensor_height, c.shift_x, c.shift_y = fit, 40 + 3 * i, 30, 22, 0.03, -0.05 * i
        o = bpy.data.objects.new(c.name, c)
        s.collection.objects.link(o)
        eye = Vector((5 * math.cos(2 * i), 5 * math.sin(2 * i), 1 + i))
        o.location, o.rotation_euler = eye, (Vector((0, 0, 2)) - eye).to_track_quat("-Z", "Y").to_euler()
        if i == 1:
            o.parent = up
            o.rotation_euler = (Vector((0, 0, 2)) - 2 * eye - up.location).to_track_quat("-Z", "Y").to_euler()
    bpy.context.view_layer.update()
    return s


def pixels(points):
    """Blender's own projection: where each camera sees the points, in pixels from the picture's upper left corner."""
    from bpy_extras.object_utils import world_to_camera_view
    from pyrovox_blender import cameras
    s, out = bpy.context.scene, {}
    (w, h), _ = cameras.picture(s)
    for o in s.objects:
        if o.type == "CAMERA":
            at = [world_to_camera_view(s, o, Vector(p)) for p in points]
            out[o.name] = [[v.x * w, (1 - v.y) * h] for v in at]
    return out


def cameras():
    """Two scenes' cameras written, and those of a rig read; and what Blender itself sees of points (m)."""
    points = json.loads(more[0])
    for kind in range(2):
        scene_of(kind)
        assert bpy.ops.pyrovox.cameras_out(filepath=f"{more[1]}/scene-{kind}.json") == {"FINISHED"}
        found[f"scene-{kind}"] = pixels([[v / 0.5 for v in p] for p in points])
    bare()
    found["none"] = wrong(lambda: bpy.ops.pyrovox.cameras_out(filepath=f"{more[1]}/no.json"))
    found["not one"] = wrong(lambda: bpy.ops.pyrovox.cameras_in(filepath=__file__))
    for o in list(bpy.data.objects):
        bpy.data.objects.remove(o)
    assert bpy.ops.pyrovox.cameras_in(filepath=more[2]) == {"FINISHED"}
    bpy.context.view_layer.update()
    found["rig"] = pixels(points)


def by_hand(live, until, seconds=120):
    """There is no event loop in the background: the timer's function is called by hand."""
    end = time.monotonic() + seconds
    while not until():
        assert time.monotonic() < end, (live.words(), until)
        live.tick()
        time.sleep(0.005)


def refusals():
    """Each bad input its sentence, and nothing left behind."""
    from pyrovox_blender import follow, vdb
    live, s = follow.live, bpy.context.scene.pyrovox
    good, full = more[:2]
    host, token = good.split("#")
    connect = bpy.ops.pyrovox.connect
    found["nothing typed"] = wrong(connect)
    s.address = "ftp://lab/"
    found["no address"] = live.error
    s.address = host
    found["no token"] = wrong(connect)
    found["pause"], found["record"], found["bake"] = wrong(bpy.ops.pyrovox.pause), wrong(bpy.ops.pyrovox.record), wrong(bpy.ops.pyrovox.bake)
    s.address = good
    modules = {n: sys.modules.get(n) for n in ("openvdb", "pyopenvdb")}
    sys.modules.update({n: None for n in modules})
    found["no openvdb"] = wrong(connect)
    for n, m in modules.items():
        sys.modules.pop(n) if m is None else sys.modules.update({n: m})
    before = vdb.tempfile.mkdtemp

    def unwritable(**_):
        raise PermissionError(13, "Permission denied")
    vdb.tempfile.mkdtemp = unwritable
    found["temporary folder"] = wrong(connect)
    vdb.tempfile.mkdtemp = before
    assert live.stream is None
    for name, address in (("wrong token", host + "#" + "0" * 32), ("nobody there", "http://127.0.0.1:1/#" + token), ("no such host", "http://nowhere.invalid/#" + token),
                          ("https", good.replace("http:", "https:"))):
        s.address = address
        assert connect() == {"FINISHED"}
        by_hand(live, lambda: live.stream.error)
        found[name] = live.words()[1]
        bpy.ops.pyrovox.disconnect()
    # a certificate of its own: refused until it is named
    s.address = more[2]
    connect()
    by_hand(live, lambda: live.stream.state == "failed")
    found["certificate"] = live.words()[1]
    for name, path in (("no certificate", zipped), ("tls", more[3])):
        s.certificate = path
        connect()
        by_hand(live, lambda: live.stream.state == "failed" or live.shown)
        found[name] = live.words()[1]
    bpy.ops.pyrovox.disconnect()
    live.shown = None
    s.address, s.folder = good, "//there"
    connect()
    by_hand(live, lambda: live.shown)
    found["unsaved"] = wrong(bpy.ops.pyrovox.record)
    s.folder = "/proc/nowhere"
    found["folder"] = wrong(bpy.ops.pyrovox.record)
    # a disk that is full: a recording ends and says so, the live flame goes on
    s.folder = full
    bpy.ops.pyrovox.record()
    by_hand(live, lambda: live.stream.notice)
    found["full"] = live.words()[1]
    shown = live.shown
    by_hand(live, lambda: live.shown is not shown)
    found["left in it"] = [n for _, _, names in os.walk(full) for n in names if n.startswith(".part")]
    bpy.ops.pyrovox.disconnect()
    live.shelf.close()
    live.shelf = vdb.Shelf(full)
    live.shown = None
    with open(f"{full}/ballast", "wb") as f:
        try:
            f.write(bytes(64 << 20))
        except OSError:
            pass
    connect()
    by_hand(live, lambda: live.stream.error)
    found["temporary folder full"] = live.words()[1]
    os.remove(f"{full}/ballast")
    by_hand(live, lambda: live.shown)  # somebody made room
    found["then"] = live.words()[1]
    # what is saved has no token
    bpy.ops.wm.save_as_mainfile(filepath=f"{folder}/saved.blend", compress=False)
    with open(f"{folder}/saved.blend", "rb") as f:
        text = f.read()
    found["saved"], found["token saved"] = b"pyrovox" in text, token.encode() in text
    found["reprs"] = token in repr(live.address) + str(s.address) + str(live.words())
    bpy.ops.preferences.addon_disable(module="pyrovox_blender")


def latency():
    """From published to Volume.filepath set, one by one."""
    from pyrovox_blender import follow
    live = follow.live
    bpy.context.scene.pyrovox.address = more[0]
    bpy.ops.pyrovox.connect()
    ages, last, end = [], None, time.monotonic() + 120
    while len(ages) < 220 and time.monotonic() < end:
        pause = live.tick()
        if live.shown is not last:
            last = live.shown
            ages.append((time.time_ns() - last.t_publish_ns) / 1e6)
        time.sleep(pause)
    found["ms"] = ages[20:]


# ---- on a screen --------------------------------------------------------------------------------


def follow_scene():
    """A live daemon for 100 volumes, and all that may happen to who watches it.  The timers are Blender's own."""
    import pyopenvdb
    from pyrovox_blender import flame, follow, vdb
    live, shown = follow.live, []
    was = vdb.Shelf.__init__
    vdb.Shelf.__init__ = lambda self, *a: was(self, *a, files=20)  # sooner bounded

    def watched():
        """Each volume that is shown, when it is."""
        s, old = live.stream, live.stream.shown

        def note(e):
            v = flame.find()
            assert v.filepath == e.path and os.path.exists(e.path)
            shown.append([e.set, e.session, (time.time_ns() - e.t_publish_ns) / 1e6])
            if len(shown) % 10 == 0:
                grids = pyopenvdb.readAll(e.path)[0]
                assert sorted(g.name for g in grids) == ["blue", "density", "green", "red"] and all(g.activeVoxelCount() > 0 for g in grids)
            old(e)
        s.shown = note

    def rss():
        with open("/proc/self/status") as f:
            return int(next(line for line in f if line.startswith("VmRSS")).split()[1]) / 1024
    scene = bpy.context.scene
    scene.pyrovox.address, scene.pyrovox.folder = more[0], f"{folder}/kept"
    view = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == "VIEW_3D").spaces[0]
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    view.show_region_ui, view.shading.type = True, "WIREFRAME"  # software GL takes seconds for any other
    import pyrovox_blender
    panel = pyrovox_blender.PYROVOX_PT_panel  # to the tab that is open: which one is, scripts cannot say before 4.2
    bpy.utils.unregister_class(panel)
    panel.bl_category, panel.bl_order = "Item", -1
    bpy.utils.register_class(panel)
    bpy.ops.pyrovox.connect()
    watched()
    yield lambda: len(shown) >= 30
    found["rss"] = [rss()]
    yield lambda: len(shown) >= 100
    found["rss"].append(rss())
    found["first"], found["words"] = list(shown), live.words()
    found["files"] = len([n for n in os.listdir(live.shelf.folder)])
    bpy.ops.pyrovox.pause()
    view.shading.type = "SOLID"
    at = time.monotonic()
    yield lambda: time.monotonic() - at > 2
    bpy.ops.screen.screenshot(filepath=f"{folder}/live.png")
    view.shading.type = "WIREFRAME"
    # while it is paused nothing comes
    at = time.monotonic()
    yield lambda: time.monotonic() - at > 1.5  # what was under way
    n = len(shown)
    yield lambda: time.monotonic() - at > 4
    found["while paused"] = len(shown) - n
    bpy.ops.pyrovox.pause()
    yield lambda: len(shown) > n + 3
    # an undo that brings back a file that is gone: the newest is shown again
    bpy.ops.ed.undo_push(message="here")
    n = len(shown)
    yield lambda: len(shown) > n + 25
    bpy.ops.pyrovox.pause()
    at = time.monotonic()
    yield lambda: time.monotonic() - at > 1.5
    bpy.ops.ed.undo_push(message="there")
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.ed.undo()
    yield lambda: flame.find() is not None and flame.find().filepath == live.shown.path and os.path.exists(live.shown.path)
    bpy.ops.pyrovox.pause()
    # record, and bake what was recorded at the scene's speed
    bpy.ops.pyrovox.record()
    yield lambda: len(live.take.entries) >= 15
    bpy.ops.pyrovox.record()
    take = live.take
    yield lambda: os.path.dirname(live.shown.path) != take.folder  # one may still have been on its way there
    found["recorded"] = [[e.set, e.t_exposure_ns, os.path.exists(e.path)] for e in take.entries]
    found["names"] = sorted(os.listdir(take.folder))
    bpy.ops.pyrovox.bake()
    baked = flame.find(flame.BAKED)
    found["baked"] = [baked.is_sequence, baked.frame_start, baked.frame_duration, os.path.basename(baked.filepath), len(os.listdir(os.path.dirname(baked.filepath))),
                      bpy.context.scene.render.fps, [o.hide_render for o in bpy.data.objects if o.data == flame.find()], live.paused]
    bpy.ops.pyrovox.pause()
    # the bridge is killed and comes back with the same token; then with another
    n, yet = len(shown), ask("kill-bridge")
    yield lambda: live.stream.error
    found["bridge gone"] = live.words()[1]
    yield yet
    yield lambda: len(shown) > n + 5 and not live.words()[1]
    # a daemon with another grid: another session
    n, sessions, yet = len(shown), live.stream.sessions, ask("other-grid")
    yield yet
    yield lambda: len(shown) > n + 5 and live.stream.sessions > sessions and shown[-1][1] != shown[0][1]
    found["spacing"] = [list(live.shown.spacing), [list(o.delta_location) for o in bpy.data.objects if o.data == flame.find()]]
    # another .blend: the flame appears there
    bpy.ops.wm.read_homefile(use_empty=True)
    n = len(shown)
    yield lambda: len(shown) > n + 2 and flame.find() is not None
    # the Volume is deleted
    bpy.data.volumes.remove(flame.find())
    yield lambda: live.stream is None
    found["deleted"] = live.words()[1]
    bpy.ops.pyrovox.connect()
    watched()
    n = len(shown)
    yield lambda: len(shown) > n + 2
    yield ask("new-token")
    yield lambda: live.stream.state == "failed"
    found["new token"] = live.words()[1]
    # disabled while it is connected
    with open(f"{folder}/address") as f:
        bpy.context.scene.pyrovox.address = f.read()
    bpy.ops.pyrovox.disconnect()
    bpy.ops.pyrovox.connect()
    watched()
    n = len(shown)
    yield lambda: len(shown) > n + 2
    was_in, thread = live.shelf.folder, live.stream._thread
    bpy.ops.preferences.addon_disable(module="pyrovox_blender")
    found["disabled"] = [os.path.exists(was_in), thread.is_alive(), bpy.app.timers.is_registered(follow.tick)]
    # and File > Quit while it is
    bpy.ops.preferences.addon_enable(module="pyrovox_blender")
    from pyrovox_blender import follow as again
    live = again.live
    with open(f"{folder}/address") as f:
        bpy.context.scene.pyrovox.address = f.read()
    bpy.ops.pyrovox.connect()
    yield lambda: live.shown is not None
    found["shelf"] = live.shelf.folder
    found["all"] = shown


def run(scene, seconds=500):
    """Go on each time what is waited for is there; then end Blender as File > Quit does."""
    scene, end = scene(), time.monotonic() + seconds
    waiting = [lambda: True]

    def go():
        try:
            if waiting[0]():
                waiting[0] = next(scene)
            elif time.monotonic() > end:
                from pyrovox_blender.follow import live
                raise TimeoutError(f"line {scene.gi_frame.f_lineno}: {live.words()}")
            return 0.02
        except StopIteration:
            pass
        except BaseException as e:
            import traceback
            traceback.print_exc()
            found["failed"] = f"{type(e).__name__}: {e}"
        say()
        bpy.ops.wm.quit_blender()
        return None
    bpy.app.timers.register(go, first_interval=1, persistent=True)


bpy.context.preferences.view.show_splash = False
install()
if what == "follow":
    run(follow_scene)
else:
    {"sequence": sequence, "picture": picture, "refusals": refusals, "cameras": cameras, "latency": latency}[what]()
    say()
