# SPDX-License-Identifier: MIT
"""blender -b --factory-startup -P blender_cases.py -- ADDONS PROGRAM FOLDER CASE [WIDTH SAMPLES]: one case of test_blender.py.

The scene is a head of wax, 50 mm wide, with each kind of light; a unit is a centimetre. What a case finds is printed as one line of JSON.
"""
import json
import math
import os
import sys

import bpy
import numpy

GIVEN = sys.argv[sys.argv.index('--') + 1:]
ADDONS, PROGRAM, FOLDER, CASE = GIVEN[:4]
WIDTH, SAMPLES = (int(n) for n in (GIVEN[4:] or ['96', '16']))
LIGHTS = [('POINT', 250, (4, -6, 8), (0, 0, 0)), ('AREA', 1200, (-7, -5, 7), (60, 0, -54)), ('SUN', 0.6, (0, 0, 9), (-50, 0, 0)),
          ('SPOT', 800, (3, 8, 6), (-68, 0, -20))]


def add_light(kind, energy, location, turn):
    data = bpy.data.lights.new(kind.title(), kind)
    data.energy = energy
    if kind == 'AREA':
        data.size = 4
    elif kind != 'SUN':
        data.shadow_soft_size = 0.02
    if kind == 'SPOT':
        data.spot_size = math.radians(60)
    thing = bpy.data.objects.new(kind.title(), data)
    thing.location, thing.rotation_euler = location, [math.radians(a) for a in turn]
    bpy.context.collection.objects.link(thing)
    return thing


def build():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.unit_settings.scale_length = 0.01 # a unit is a centimetre
    wax = bpy.data.materials.new('Wax')
    wax.use_nodes = True
    node = wax.node_tree.nodes['Principled BSDF']
    node.inputs['Base Color'].default_value = node.inputs['Subsurface Color'].default_value = (0.8, 0.5, 0.3, 1)
    node.inputs['Subsurface'].default_value = 1
    node.inputs['Subsurface Radius'].default_value = (1.0, 0.5, 0.25)
    node.inputs['Roughness'].default_value = 0.4
    node.inputs['Specular'].default_value = 0.5
    bpy.ops.mesh.primitive_monkey_add(size=5, location=(0, 0, 3))
    head = bpy.context.object
    bpy.ops.object.shade_smooth()
    smooth, closed = head.modifiers.new('Smooth', 'SUBSURF'), head.modifiers.new('Closed', 'REMESH')
    smooth.levels = smooth.render_levels = 2
    closed.mode, closed.voxel_size, closed.use_smooth_shade = 'VOXEL', 0.04 if WIDTH > 200 else 0.1, True
    head.data.materials.append(wax)
    stone = bpy.data.materials.new('Stone')
    stone.use_nodes = True
    stone.node_tree.nodes['Principled BSDF'].inputs['Base Color'].default_value = (0.3, 0.3, 0.3, 1)
    bpy.ops.mesh.primitive_plane_add(size=40, location=(0, 0, 1))
    bpy.context.object.data.materials.append(stone)
    for row in LIGHTS:
        add_light(*row)
    world = bpy.data.worlds.new('World')
    world.use_nodes = True
    world.node_tree.nodes['Background'].inputs['Color'].default_value = (0.05, 0.06, 0.08, 1)
    scene.world = world
    data = bpy.data.cameras.new('Camera')
    data.angle = math.radians(28)
    thing = bpy.data.objects.new('Camera', data)
    thing.location, thing.rotation_euler = (0, -15, 4.2), (math.radians(86), 0, 0)
    bpy.context.collection.objects.link(thing)
    scene.camera = thing
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, WIDTH * 3 // 4
    scene.render.resolution_percentage = 100
    bpy.ops.object.select_all(action='DESELECT')
    return scene, wax


def pixels(image):
    made = numpy.empty(len(image.pixels), numpy.float32)
    image.pixels.foreach_get(made)
    return made.reshape(image.size[1], image.size[0], 4)[::-1]


def cycles(scene):
    scene.render.engine = 'CYCLES'
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.device = SAMPLES, False, 'CPU'
    scene.render.threads_mode, scene.render.threads = 'FIXED', 2
    scene.view_settings.view_transform = 'Raw'
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = 'OPEN_EXR', '32'
    scene.render.filepath = os.path.join(FOLDER, 'cycles.exr')
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    made = pixels(image)
    bpy.data.images.remove(image)
    return made


def pellucid():
    bpy.ops.render.pellucid()
    return pixels(bpy.data.images['Pellucid'])


def both(scene):
    return pellucid()[:, :, :3], cycles(scene)[:, :, :3]


def sent():
    """The scene file, with the warnings."""
    from pellucid_blender import convert
    said = []
    return convert.scene_file(bpy.context, FOLDER, said.append) | {'said': said}


# --- The cases: each takes the scene and its wax, and returns what JSON has -------------------------------------------------------------

def case_sent(scene, wax):
    made = sent()
    with open(os.path.join(FOLDER, 'scene.json'), 'w', encoding='utf-8') as file:
        json.dump({k: v for k, v in made.items() if k != 'said'}, file)
    return made


def case_opaque(scene, wax):
    """Two objects of stone, whose subsurface weight is 0."""
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.data.materials.append(bpy.data.materials['Stone'])
    bpy.ops.object.select_all(action='DESELECT')
    said = sent()['said']
    bpy.data.materials['Stone'].pellucid.source = 'OPAQUE'
    return {'said': said, 'chosen': sent()['said']}


def case_selection(scene, wax):
    bpy.data.objects['Suzanne'].select_set(True)
    made = sent()
    return {'materials': made['materials'], 'size': os.path.getsize(os.path.join(FOLDER, 'scene.glb')),
            'selected': [o.name for o in bpy.context.selected_objects]}


def case_rule(scene, wax):
    """Each branch of the rule for a material."""
    node = wax.node_tree.nodes['Principled BSDF']
    found = {}
    for method in ('BURLEY', 'RANDOM_WALK_FIXED_RADIUS', 'RANDOM_WALK'):
        node.subsurface_method = method
        found[method] = sent()['materials']['Wax']
    node.inputs['Subsurface'].default_value = 0.25
    node.inputs['Base Color'].default_value = (0.4, 0.4, 0.4, 1)
    node.inputs['Subsurface Color'].default_value = (0.8, 0.6, 0.4, 1)
    found['share'] = sent()['materials']['Wax']
    image = bpy.data.images.new('Two', 2, 1, float_buffer=True)
    image.pixels = (0.2, 0.2, 0.2, 1, 0.6, 0.4, 0.2, 1)
    source = wax.node_tree.nodes.new('ShaderNodeTexImage')
    source.image = image
    wax.node_tree.links.new(source.outputs['Color'], node.inputs['Base Color'])
    found['image'] = sent()
    node.inputs['Subsurface'].default_value = 0
    found['none'] = sent()['materials']
    wax.pellucid.source, wax.pellucid.preset = 'PRESET', 'skin'
    found['preset'] = sent()['materials']
    return found


def case_presets(scene, wax):
    addon = sys.modules['pellucid_blender']
    rows = [row[0] for row in addon.presets(None, bpy.context, 'MILK')]
    methods = [row[0] for row in addon.methods(None, bpy.context, '')]
    wax.pellucid.source, wax.pellucid.preset = 'PRESET', 'wholemilk'
    milk = pellucid()[:, :, :3].mean((0, 1)).tolist()
    return {'rows': rows, 'methods': methods, 'milk': milk}


def case_picture(scene, wax):
    ours, theirs = both(scene)
    numpy.save(os.path.join(FOLDER, 'pellucid.npy'), ours)
    numpy.save(os.path.join(FOLDER, 'cycles.npy'), theirs)
    image, (h, w) = bpy.data.images['Pellucid'], ours.shape[:2]
    face = slice(h // 4, h // 2), slice(3 * w // 8, 5 * w // 8)
    return {'float': image.is_float, 'size': list(image.size), 'sky': [ours[0, 0].tolist(), theirs[0, 0].tolist()],
            'means': [ours.mean((0, 1)).tolist(), theirs.mean((0, 1)).tolist()],
            'face': [ours[face].mean((0, 1)).tolist(), theirs[face].mean((0, 1)).tolist()]}


def case_lights(scene, wax):
    """One light after the other, seen on the floor below it."""
    bpy.data.objects.remove(bpy.data.objects['Suzanne'])
    scene.world = None
    scene.camera.location, scene.camera.rotation_euler = (0, -6, 9), (math.radians(37), 0, 0)
    found = {}
    for kind, energy, _, _ in LIGHTS:
        for thing in [o for o in bpy.data.objects if o.type == 'LIGHT']:
            bpy.data.objects.remove(thing)
        add_light(kind, energy, (0, 0, 8), (10, 0, 0))
        ours, theirs = both(scene)
        middle = slice(ours.shape[0] * 2 // 5, ours.shape[0] * 3 // 5), slice(ours.shape[1] * 2 // 5, ours.shape[1] * 3 // 5)
        found[kind] = [float(ours[middle].mean()), float(theirs[middle].mean())]
    return found


def case_world(scene, wax):
    """The environment of an image with all pixels different, rotated."""
    for thing in [o for o in bpy.data.objects if o.type == 'LIGHT']:
        bpy.data.objects.remove(thing)
    y, x = numpy.mgrid[0:32, 0:64]
    rgba = numpy.stack([0.1 + x / 64, 0.1 + y / 32, 1.2 - x / 64, numpy.ones((32, 64))], -1).astype(numpy.float32)
    image = bpy.data.images.new('Sky', 64, 32, float_buffer=True)
    image.pixels.foreach_set(rgba.ravel())
    tree = scene.world.node_tree
    source, mapping = tree.nodes.new('ShaderNodeTexEnvironment'), tree.nodes.new('ShaderNodeMapping')
    source.image, mapping.inputs['Rotation'].default_value[2] = image, math.radians(40)
    where = tree.nodes.new('ShaderNodeTexCoord')
    tree.links.new(where.outputs['Generated'], mapping.inputs['Vector'])
    tree.links.new(mapping.outputs['Vector'], source.inputs['Vector'])
    tree.links.new(source.outputs['Color'], tree.nodes['Background'].inputs['Color'])
    bpy.data.objects['Plane'].hide_render = True
    scene.camera.rotation_euler[0] += 0.3
    ours, theirs = both(scene)
    rows = [[0, 0], [0, -1], [8, 0], [8, -1]]
    return {'ours': [ours[y, x].tolist() for y, x in rows], 'theirs': [theirs[y, x].tolist() for y, x in rows]}


def case_transparent(scene, wax):
    scene.render.film_transparent = True
    bpy.data.objects['Plane'].hide_render = True
    ours, theirs = pellucid()[:, :, 3], cycles(scene)[:, :, 3]
    return {'means': [float(ours.mean()), float(theirs.mean())], 'corner': float(ours[0, 0]), 'most': float(ours.max())}


def case_lens(scene, wax):
    lens = scene.camera.data
    lens.sensor_fit, lens.type, lens.ortho_scale = 'AUTO', 'ORTHO', 8
    flat = sent()['camera']
    lens.type, lens.dof.use_dof, lens.dof.focus_distance, lens.dof.aperture_fstop, lens.shift_x = 'PERSP', True, 15, 2.0, 0.1
    made = sent()
    lens.type = 'PANO'
    return {'flat': flat, 'deep': made['camera'], 'said': made['said'], 'lens': lens.lens, 'refused': refused(bpy.ops.render.pellucid)}


def refused(call):
    try:
        call()
    except RuntimeError as fault:
        return str(fault)
    return ''


def case_errors(scene, wax):
    found, preferences = {}, bpy.context.preferences.addons['pellucid_blender'].preferences
    preferences.program = '/nowhere/pellucid'
    found['wrong path'] = refused(bpy.ops.render.pellucid)
    preferences.program, path = '', os.environ['PATH']
    os.environ['PATH'] = FOLDER
    found['not in PATH'] = refused(bpy.ops.render.pellucid)
    os.environ['PATH'], preferences.program = path, PROGRAM
    wax.pellucid.source, wax.pellucid.preset = 'PRESET', 'marbel'
    found['wrong preset'] = refused(bpy.ops.render.pellucid)
    wax.pellucid.source = 'PRINCIPLED'
    scene.pellucid.method = 'screenspace'
    found['wrong method'] = refused(bpy.ops.render.pellucid_view)
    scene.pellucid.method, scene.camera = 'screen-space', None
    found['no camera'] = refused(bpy.ops.render.pellucid)
    for thing in [o for o in bpy.data.objects if o.type == 'MESH']:
        bpy.data.objects.remove(thing)
    bpy.context.view_layer.update()
    found['nothing'] = refused(bpy.ops.render.pellucid)
    return found


def case_view(scene, wax):
    bpy.ops.render.pellucid_view()
    process, folder = sys.modules['pellucid_blender'].viewers[0]
    alive = process.poll() is None
    bpy.ops.preferences.addon_disable(module='pellucid_blender')
    return {'alive': alive, 'ended': process.poll() is not None, 'left': os.path.exists(folder.name)}


def main():
    sys.path.insert(0, ADDONS)
    scene, wax = build()
    bpy.ops.preferences.addon_enable(module='pellucid_blender')
    bpy.context.preferences.addons['pellucid_blender'].preferences.program = PROGRAM
    bpy.context.view_layer.update()
    print('found ' + json.dumps(globals()['case_' + CASE](scene, wax)))


main()
