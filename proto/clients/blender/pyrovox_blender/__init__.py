"""The flame of a Pyrovox daemon in Blender while it burns, by way of `pyrovox view`.  README.md beside this folder."""
import textwrap
from typing import Any

import bpy
from bpy.props import BoolProperty, IntProperty, PointerProperty, StringProperty

from bpy_extras.io_utils import ExportHelper, ImportHelper

from . import _page, cameras
from .follow import Wrong, live, loaded
from .websocket import Address, BadAddress

bl_info = {
    "name": "Pyrovox",
    "author": "The Pyrovox maintainers",
    "version": (0, 1, 0),
    "blender": (3, 3, 0),
    "location": "3D View > Sidebar > Pyrovox",
    "description": "Shows the live flame of a Pyrovox daemon as a volume",
    "category": "Import-Export",
}


def get_address(_: Any) -> str:
    return str(live.address) if live.address is not None else ""


def set_address(_: Any, text: str) -> None:
    """The token stays here: what Blender is given back, saves and logs has none."""
    live.error = ""
    if not text.strip():
        live.address = None
        return
    try:
        a = Address.read(text)
    except BadAddress as e:
        live.error = str(e)
        return
    if not a.token and live.address is not None and str(a) == str(live.address):
        return
    live.address = a


class PyrovoxSettings(bpy.types.PropertyGroup):  # type: ignore[misc]
    address: StringProperty(  # type: ignore[valid-type]
        name="Address", get=get_address, set=set_address,
        description="What pyrovox view prints, whole. The token behind '#' is kept until Blender ends, and neither shown nor saved")
    certificate: StringProperty(  # type: ignore[valid-type]
        name="Certificate", subtype="FILE_PATH", description="https: the bridge's certificate, where this computer does not trust it already")
    folder: StringProperty(  # type: ignore[valid-type]
        name="Folder", subtype="DIR_PATH", default="//pyrovox", description="Recordings and baked sequences go to new folders in this one")
    true_speed: BoolProperty(  # type: ignore[valid-type]
        name="True speed", default=True, description="Bake one file for each frame at the scene's rate; otherwise one for each volume")


class PyrovoxPreferences(bpy.types.AddonPreferences):  # type: ignore[misc]
    bl_idname = __package__
    memory: IntProperty(  # type: ignore[valid-type]
        name="Memory for a volume, MiB", default=_page.MEMORY >> 20, min=1, max=16384, description="Volumes that need more are refused")

    def draw(self, context: Any) -> None:
        self.layout.prop(self, "memory")


def memory(context: Any) -> int:
    addon = context.preferences.addons.get(__package__)
    return int(addon.preferences.memory) << 20 if addon is not None and addon.preferences is not None else _page.MEMORY


class Button(bpy.types.Operator):  # type: ignore[misc]
    """A button: what it does, or one sentence why not."""

    def execute(self, context: Any) -> set[str]:
        try:
            self.act(context)
        except Wrong as e:
            live.error = str(e)
            self.report({"WARNING"}, str(e))
            return {"CANCELLED"}
        return {"FINISHED"}

    def act(self, context: Any) -> None:
        raise NotImplementedError


class PYROVOX_OT_connect(Button):
    """Follow the bridge: the newest volume is shown as it comes"""

    bl_idname, bl_label = "pyrovox.connect", "Connect"
    bl_options = {"REGISTER", "UNDO"}  # an undo leads back to here, and not to before the Volume was

    def act(self, context: Any) -> None:
        live.connect(bpy.path.abspath(context.scene.pyrovox.certificate), memory(context))


class PYROVOX_OT_disconnect(Button):
    """End; what is shown stays until Blender ends. Bake it to keep it"""

    bl_idname, bl_label = "pyrovox.disconnect", "Disconnect"

    def act(self, context: Any) -> None:
        live.disconnect()


class PYROVOX_OT_pause(Button):
    """Keep what is shown; the bridge sends nothing meanwhile"""

    bl_idname, bl_label = "pyrovox.pause", "Pause"

    def act(self, context: Any) -> None:
        live.pause(not live.paused)


class PYROVOX_OT_record(Button):
    """Keep the volumes that come, in a new folder in the one below"""

    bl_idname, bl_label = "pyrovox.record", "Record"

    def act(self, context: Any) -> None:
        if live.recording() is not None:
            live.record_end()
        else:
            live.record(context.scene.pyrovox.folder)


class PYROVOX_OT_bake(Button):
    """Make a sequence of what was recorded, or else of the last volumes that came, in place of the live flame"""

    bl_idname, bl_label = "pyrovox.bake", "Bake to sequence"
    bl_options = {"REGISTER", "UNDO"}

    def act(self, context: Any) -> None:
        scene = context.scene
        fps = scene.render.fps / scene.render.fps_base if scene.pyrovox.true_speed else 0
        volume, n = live.bake(scene.pyrovox.folder, fps, scene.frame_start)
        self.report({"INFO"}, f"{n} files, frames {volume.frame_start} to {volume.frame_start + n - 1}: {volume.filepath}")


class PYROVOX_OT_cameras_out(Button, ExportHelper):  # type: ignore[misc]
    """Write the scene's cameras to a file, for pyrovox calibrate import"""

    bl_idname, bl_label = "pyrovox.cameras_out", "Export cameras"
    filename_ext = ".json"

    def act(self, context: Any) -> None:
        n = cameras.write(context.scene, self.filepath)
        self.report({"INFO"}, f"{n} cameras: {self.filepath}")


class PYROVOX_OT_cameras_in(Button, ImportHelper):  # type: ignore[misc]
    """Add the cameras of a rig, from pyrovox calibrate export --to blender"""

    bl_idname, bl_label = "pyrovox.cameras_in", "Import cameras"
    bl_options = {"REGISTER", "UNDO"}
    filename_ext = ".json"

    def act(self, context: Any) -> None:
        n, other = cameras.read(context.scene, self.filepath)
        live.error = other
        self.report({"WARNING"} if other else {"INFO"}, other or f"{n} cameras")


class PYROVOX_PT_panel(bpy.types.Panel):  # type: ignore[misc]
    bl_label, bl_category, bl_space_type, bl_region_type = "Pyrovox", "Pyrovox", "VIEW_3D", "UI"

    def draw(self, context: Any) -> None:
        p, col, on = context.scene.pyrovox, self.layout.column(), live.stream is not None
        top = col.column()
        top.enabled = not on
        top.prop(p, "address", text="", icon="URL")
        if live.address is not None and live.address.tls:
            top.prop(p, "certificate")
        if on:
            col.operator("pyrovox.disconnect", icon="CANCEL")
        else:
            col.operator("pyrovox.connect", icon="PLAY")
        row = col.row(align=True)
        row.enabled = on
        row.operator("pyrovox.pause", text="Resume" if live.paused else "Pause", icon="PAUSE", depress=live.paused)
        recording = live.recording() is not None
        row.operator("pyrovox.record", text="Stop" if recording else "Record", icon="REC", depress=recording)
        col.prop(p, "folder", text="")
        col.prop(p, "true_speed")
        col.operator("pyrovox.bake", icon="SEQUENCE")
        row = col.row(align=True)
        row.operator("pyrovox.cameras_in", icon="IMPORT")
        row.operator("pyrovox.cameras_out", icon="EXPORT")
        lines, wrong = live.words()
        width = max(20, int(context.region.width / (7.5 * context.preferences.system.ui_scale)))
        box = col.box().column(align=True)
        for text in lines:
            for line in textwrap.wrap(text, width):
                box.label(text=line)
        for i, line in enumerate(textwrap.wrap(wrong, width - 3)):
            box.label(text=line, icon="ERROR" if i == 0 else "BLANK1")


CLASSES = (PyrovoxSettings, PyrovoxPreferences, PYROVOX_OT_connect, PYROVOX_OT_disconnect, PYROVOX_OT_pause, PYROVOX_OT_record, PYROVOX_OT_bake, PYROVOX_OT_cameras_in, PYROVOX_OT_cameras_out, PYROVOX_PT_panel)


def register() -> None:
    for c in CLASSES:
        bpy.utils.register_class(c)
    bpy.types.Scene.pyrovox = PointerProperty(type=PyrovoxSettings)
    bpy.app.handlers.load_post.append(loaded)


def unregister() -> None:
    live.close()
    if loaded in bpy.app.handlers.load_post:
        bpy.app.handlers.load_post.remove(loaded)
    del bpy.types.Scene.pyrovox
    for c in reversed(CLASSES):
        bpy.utils.unregister_class(c)
