"""The scene's cameras as a file for `pyrovox calibrate import`, and cameras of `pyrovox calibrate export` into the scene.

The file has Blender's own numbers.  Pyrovox converts them (recon/exchange)."""
from __future__ import annotations

import json
from typing import Any

import bpy
from mathutils import Matrix

from .follow import Wrong

FORMAT = "pyrovox-blender-cameras"


def picture(scene: Any) -> tuple[list[int], float]:
    """Size in pixels, and how much higher than wide a pixel is."""
    r = scene.render
    return [int(r.resolution_x * r.resolution_percentage / 100), int(r.resolution_y * r.resolution_percentage / 100)], r.pixel_aspect_y / r.pixel_aspect_x


def write(scene: Any, path: str) -> int:
    """How many cameras were written."""
    size, aspect = picture(scene)
    cameras = []
    for o in scene.objects:
        if o.type != "CAMERA":
            continue
        c = o.data
        cameras.append({"name": o.name, "type": c.type, "size": size, "pixel_aspect": aspect, "lens": c.lens, "sensor_fit": c.sensor_fit,
                        "sensor_width": c.sensor_width, "sensor_height": c.sensor_height, "shift": [c.shift_x, c.shift_y],
                        "matrix_world": [list(row) for row in o.matrix_world]})
    if not cameras:
        raise Wrong("the scene has no camera")
    try:
        with open(path, "w", encoding="utf-8") as f:
            json.dump({"format": FORMAT, "metres_per_unit": scene.unit_settings.scale_length, "cameras": cameras}, f, indent=1)
    except OSError as e:
        raise Wrong(f"{path}: {e.strerror}") from None
    return len(cameras)


def load(path: str) -> tuple[float, list[dict[str, Any]]]:
    try:
        with open(path, encoding="utf-8") as f:
            m = json.load(f)
        if m["format"] != FORMAT or not m["cameras"]:
            raise ValueError
        return float(m["metres_per_unit"]), list(m["cameras"])
    except OSError as e:
        raise Wrong(f"{path}: {e.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise Wrong(f"{path} is not of pyrovox calibrate export --to blender") from None


def read(scene: Any, path: str) -> tuple[int, str]:
    """Cameras of the file become the scene's; how many, and what does not fit: a scene has one size of pictures."""
    unit, cameras = load(path)
    scale, first, other = unit / scene.unit_settings.scale_length, cameras[0], ""
    for m in cameras:
        data = bpy.data.cameras.new(m["name"])
        data.sensor_fit, data.sensor_width, data.sensor_height = m["sensor_fit"], m["sensor_width"], m["sensor_height"]
        data.lens = m["lens"]
        data.shift_x, data.shift_y = m["shift"]
        o = bpy.data.objects.new(m["name"], data)
        scene.collection.objects.link(o)
        t = Matrix(m["matrix_world"])
        t.translation *= scale
        o.matrix_world = t
        high = max(m["size"])
        if m["size"] != first["size"] or abs(m["pixel_aspect"] / first["pixel_aspect"] - 1) * high > 0.1:
            other = f"{m['name']} has other pictures than {first['name']}: {m['size'][0]} x {m['size'][1]}, pixels' aspect {m['pixel_aspect']:.6g}. Set them in Output before it renders"
    r = scene.render
    r.resolution_x, r.resolution_y = first["size"]
    r.resolution_percentage = 100
    r.pixel_aspect_x, r.pixel_aspect_y = max(1, 1 / first["pixel_aspect"]), max(1, first["pixel_aspect"])
    return len(cameras), other
