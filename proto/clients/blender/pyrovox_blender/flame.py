"""The flame in Blender: a Volume, its emission material, a sequence.  Data API only: operators freeze in handlers."""
from __future__ import annotations

from typing import Any, Optional

import bpy

LIVE, BAKED = "live", "sequence"
MARK = "pyrovox"  # custom property: what a datablock is


def find(what: str = LIVE) -> Optional[Any]:
    """The Volume's datablock, by its mark: names are the user's."""
    return next((v for v in bpy.data.volumes if v.get(MARK) == what and v.users > 0), None)


def material(channels: int) -> Any:
    """Emission in 1/m as it was reconstructed: with Strength 1, light summed along a ray is the pixel of `pyrovox render`.

    An emission of strength 1 and colour c adds c times the length of way to a ray's radiance.
    """
    kind = f"emission-{channels}"
    m = next((m for m in bpy.data.materials if m.get(MARK) == kind), None)
    if m is not None:
        return m
    m = bpy.data.materials.new("Pyrovox flame" if channels == 3 else "Pyrovox flame, grey")
    m[MARK] = kind
    m.use_nodes = True
    nodes, links = m.node_tree.nodes, m.node_tree.links
    nodes.clear()
    emission, out = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    emission.label, emission.inputs["Strength"].default_value = "Strength 1: pixel values", 1
    emission.location, out.location = (-150, 0), (100, 0)
    colour = nodes.new("ShaderNodeCombineColor") if channels == 3 else None
    if colour is not None:
        colour.location = (-350, 0)
        links.new(colour.outputs["Color"], emission.inputs["Color"])
    for i, name in enumerate(("red", "green", "blue") if channels == 3 else ("density",)):
        values = nodes.new("ShaderNodeAttribute")
        values.attribute_name, values.label, values.location = name, f"{name}, 1/m", (-600, 150 - 150 * i)
        links.new(values.outputs["Fac"], colour.inputs[i] if colour is not None else emission.inputs["Color"])
    links.new(emission.outputs["Emission"], out.inputs["Volume"])
    return m


def make(what: str, name: str) -> Any:
    """A Volume and its object in the scene."""
    volume = bpy.data.volumes.new(name)
    volume[MARK] = what
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, volume))
    return volume


def dress(volume: Any, channels: int, spacing: tuple[float, float, float]) -> None:
    """Its place, and the material where the user has not put one of his own."""
    place(volume, spacing)
    m = material(channels)
    if len(volume.materials) == 0:
        volume.materials.append(m)
    elif volume.materials[0] is not None and str(volume.materials[0].get(MARK, "")).startswith("emission-") and volume.materials[0] != m:
        volume.materials[0] = m


def place(volume: Any, spacing: tuple[float, float, float]) -> None:
    """Blender before 4.5 draws a voxel's value half a voxel beyond its centre; its objects go back by that."""
    shift = tuple(-s / 2 if bpy.app.version < (4, 5, 0) else 0.0 for s in spacing)
    for o in bpy.data.objects:
        if o.data == volume and any(abs(a - b) > 1e-7 for a, b in zip(o.delta_location, shift)):
            o.delta_location = shift


def hide(volume: Any, on: bool) -> None:
    for o in bpy.data.objects:
        if o.data == volume:
            o.hide_viewport = o.hide_render = on


def sequence(files: list[str], channels: int, spacing: tuple[float, float, float], first: int) -> Any:
    """A Volume that shows files[i] at frame first + i."""
    volume = make(BAKED, "Flame sequence")
    volume.filepath = files[0]
    volume.is_sequence = True
    volume.frame_start, volume.frame_duration, volume.frame_offset = first, len(files), 0
    volume.sequence_mode = "CLIP"
    dress(volume, channels, spacing)
    return volume
