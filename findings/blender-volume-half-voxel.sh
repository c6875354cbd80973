#!/bin/sh
# Blender draws an OpenVDB grid half a voxel beyond its place.
#
# Expected: OpenVDB's transform gives the world position of a voxel's centre (index 0 of an identity transform is at 0).  Cycles
#           shows the light of a box of voxels from -2 to 2 around 0.
# Happens:  the picture's centre of light lies half a voxel further along each axis.  An overlay of a volume on cameras or
#           meshes of the same scene is off by that.
# Seen in:  blender 3.4.1+dfsg-2+b1, python3-openvdb 10.0.1-2 (Debian 12)
. "$(dirname "$0")/root.sh"
root blender=3.4.1+dfsg-2+b1 python3-openvdb=10.0.1-2
cat > "$R/try/try.py" <<'PY'
import bpy
import numpy as np
import pyopenvdb

grid = pyopenvdb.FloatGrid()
grid.name = 'density'
grid.gridClass = pyopenvdb.GridClass.FOG_VOLUME
grid.copyFromArray(np.ones((5, 5, 5), np.float32), ijk=(-2, -2, -2))
pyopenvdb.write('/try/a.vdb', grids=[grid])

bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
volume = bpy.data.volumes.new('box')
volume.filepath = '/try/a.vdb'
material = bpy.data.materials.new('light')
material.use_nodes = True
nodes, links = material.node_tree.nodes, material.node_tree.links
nodes.clear()
values, emission, end = (nodes.new('ShaderNode' + n) for n in ('Attribute', 'Emission', 'OutputMaterial'))
values.attribute_name = 'density'
links.new(values.outputs['Fac'], emission.inputs['Strength'])
links.new(emission.outputs['Emission'], end.inputs['Volume'])
volume.materials.append(material)
scene.collection.objects.link(bpy.data.objects.new('box', volume))
camera = bpy.data.objects.new('camera', bpy.data.cameras.new('camera'))
camera.data.type, camera.data.ortho_scale, camera.location = 'ORTHO', 16, (0, 0, 20)  # looks along -z, x right, y up
scene.collection.objects.link(camera)
scene.camera = camera
scene.render.engine, scene.cycles.samples, scene.cycles.device = 'CYCLES', 64, 'CPU'
scene.cycles.use_denoising = False
scene.render.resolution_x = scene.render.resolution_y = 64
scene.view_settings.view_transform = 'Raw'
scene.render.image_settings.file_format, scene.render.image_settings.color_depth = 'OPEN_EXR', '32'
scene.render.filepath = '/try/a.exr'
bpy.ops.render.render(write_still=True)
image = bpy.data.images.load('/try/a.exr')
light = np.array(image.pixels[:]).reshape(64, 64, 4)[..., 0]
at = (np.arange(64) + 0.5) / 4 - 8
print('SEEN Blender %s: centre of light at x %.1f, y %.1f voxels' % (
    bpy.app.version_string, light.sum(0) @ at / light.sum(), light.sum(1) @ at / light.sum()))
PY
ends "$(inside blender --background --factory-startup --python-exit-code 1 --python try.py 2>&1 | sed -n 's/^SEEN //p')" \
    'Blender 3.4.1: centre of light at x 0.5, y 0.5 voxels'
