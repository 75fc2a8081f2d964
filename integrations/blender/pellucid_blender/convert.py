# SPDX-License-Identifier: MIT
"""Blender's scene as a scene file of Pellucid. docs/guide/blender.md states the rules."""
import math
import os

import bpy
from mathutils import Vector

from .program import Trouble

SHAPES = {'MESH', 'CURVE', 'SURFACE', 'FONT', 'META'}
# The meaning of a Principled node's radius. Blender 4.0 gave the name RANDOM_WALK to the former RANDOM_WALK_FIXED_RADIUS.
RADIUS_KINDS = {'BURLEY': 'cycles', 'RANDOM_WALK_FIXED_RADIUS': 'cycles', 'RANDOM_WALK_SKIN': 'cycles-skin',
                'RANDOM_WALK': 'cycles' if bpy.app.version >= (4, 0, 0) else 'cycles-skin'}


def turned(v):
    """From z up to y up, as the glTF exporter rotates."""
    return [v[0], v[2], -v[1]]


# --- Materials ------------------------------------------------------------------------------------------------------------------------

def socket(node, *names):
    return next((node.inputs[n] for n in names if n in node.inputs), None)


def number(node, name, warn):
    at = socket(node, name)
    if at.is_linked:
        warn(f'"{name}" is linked: its own value {at.default_value:g} is used everywhere')
    return at.default_value


def color(node, name, warn):
    """A linear colour; of an image texture its mean."""
    at = socket(node, name)
    if not at.is_linked:
        return list(at.default_value)[:3]
    source = at.links[0].from_node
    image = source.image if source.type == 'TEX_IMAGE' else None
    if not image or not image.has_data and not len(image.pixels):
        warn(f'"{name}" is linked to "{source.name}", which is no image: its own colour is used everywhere')
        return list(at.default_value)[:3]
    warn(f'"{name}" is an image: coefficients are made of its mean. A preset keeps the image')
    return mean(image)


def mean(image):
    import numpy
    pixels = numpy.empty(len(image.pixels), numpy.float32)
    image.pixels.foreach_get(pixels)
    rgb = pixels.reshape(-1, image.channels)[:, :3].astype(float)
    if rgb.shape[1] < 3:
        rgb = numpy.repeat(rgb[:, :1], 3, 1)
    if image.colorspace_settings.name == 'sRGB':
        rgb = numpy.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return [float(c) for c in rgb.mean(0)]


def principled(material):
    """The Principled node that the output's surface is connected to."""
    if not material.use_nodes or not material.node_tree:
        return None
    output = material.node_tree.get_output_node('ALL') or material.node_tree.get_output_node('CYCLES')
    if not output or not output.inputs['Surface'].is_linked:
        return None
    node = output.inputs['Surface'].links[0].from_node
    return node if node.type == 'BSDF_PRINCIPLED' else None


def medium(material, millimetres, warn):
    """The scene file's entry of a material's own node, or None without subsurface scattering."""
    node = principled(material)
    if not node:
        warn('has no Principled node at its output, and is opaque')
        return None
    old = 'Subsurface Color' in node.inputs # before Blender 4.0
    weight = number(node, 'Subsurface' if old else 'Subsurface Weight', warn)
    if weight <= 0:
        warn('has Subsurface 0 and is opaque: raise it, or choose "Built-in" under Material, Pellucid')
        return None
    base = color(node, 'Base Color', warn)
    if old:
        below = color(node, 'Subsurface Color', warn)
        base = [(1 - weight) * b + weight * s for b, s in zip(base, below)]
    scale = weight if old else number(node, 'Subsurface Scale', warn)
    if not old and weight < 1:
        warn(f'"Subsurface Weight" is {weight:g}: all diffuse light goes below the surface')
    at = socket(node, 'Subsurface Radius')
    if at.is_linked:
        warn('"Subsurface Radius" is linked: its own values are used everywhere')
    radius = [scale * r * millimetres for r in at.default_value]
    if min(radius) < 1e-6:
        warn('has a subsurface radius of 0: it is raised to 0.001 mm')
    if number(node, 'Subsurface Anisotropy', warn) != 0:
        warn('"Subsurface Anisotropy" is ignored: the rule takes 0')
    kind = RADIUS_KINDS.get(node.subsurface_method)
    if not kind:
        raise Trouble(f'Material "{material.name}": the subsurface method {node.subsurface_method} is unknown, '
                      f'allowed: {", ".join(sorted(RADIUS_KINDS))}')
    eta = number(node, 'Subsurface IOR' if kind == 'cycles-skin' and 'Subsurface IOR' in node.inputs else 'IOR', warn)
    return {'color': [min(max(c, 0.0), 0.999) for c in base], 'radius': [f'{max(r, 1e-3):.9g}mm' for r in radius], 'radius_kind': kind,
            'eta': min(max(eta, 1.0), 4.0)}


def entries(objects, millimetres, warn):
    found, seen = {}, set()
    for thing in objects:
        slots = [s.material for s in thing.material_slots if s.material]
        if not slots:
            warn(f'Object "{thing.name}" has no material: it is rendered as marble')
        for material in slots:
            def about(text, name=material.name):
                warn(f'Material "{name}": {text}')
            settings = material.pellucid
            if material.name in seen:
                continue
            seen.add(material.name)
            if settings.source == 'PRESET':
                entry = {'preset': settings.preset}
            elif settings.source == 'OPAQUE':
                entry = {'opaque': True}
            else:
                entry = medium(material, millimetres, about)
            if entry:
                found[material.name] = entry
    return found


# --- Camera and lights ----------------------------------------------------------------------------------------------------------------

def camera(scene, warn):
    thing = scene.camera
    if not thing:
        raise Trouble(f'Scene "{scene.name}" has no camera. Add one, and make it the active one')
    lens = thing.data
    if lens.type == 'PANO':
        raise Trouble(f'Camera "{thing.name}" is panoramic, allowed: perspective, orthographic')
    matrix = thing.matrix_world
    corners = lens.view_frame(scene=scene)
    height = max(c.y for c in corners) - min(c.y for c in corners)
    if lens.shift_x or lens.shift_y:
        warn(f'Camera "{thing.name}": its shift is ignored')
    eye, axis = matrix.translation, (matrix.to_3x3() @ Vector((0, 0, -1))).normalized()
    made = {'from': turned(eye), 'to': turned(eye + axis), 'up': turned((matrix.to_3x3() @ Vector((0, 1, 0))).normalized())}
    if lens.type == 'ORTHO':
        return made | {'ortho_height': height}
    angle = 2 * math.atan(height / 2 / -corners[0].z)
    made['fov_deg'] = math.degrees(angle)
    if lens.dof.use_dof:
        focus = lens.dof.focus_distance
        if lens.dof.focus_object:
            focus = (lens.dof.focus_object.matrix_world.translation - eye).dot(axis)
        # The scene file's lens is that of a frame 24 mm high. The discs are as wide as Blender's, whose diameter is in its units.
        diameter = lens.lens / lens.dof.aperture_fstop * scene.unit_settings.scale_length
        made |= {'focus': max(focus, 1e-6), 'f_number': min(max(12 / math.tan(angle / 2) / diameter, 0.1), 1e6)}
    return made


def light(thing, metres, warn):
    """A light with Cycles' radiance on the scene's surfaces. Watts over a distance in Blender's units: metres squares them away."""
    source, matrix = thing.data, thing.matrix_world
    at, axis = matrix.translation, (matrix.to_3x3() @ Vector((0, 0, -1))).normalized()
    up = turned((matrix.to_3x3() @ Vector((0, 1, 0))).normalized())
    power = [source.energy * c for c in source.color]
    made = {'name': thing.name}
    if source.use_nodes and source.node_tree and any(n.type not in ('EMISSION', 'OUTPUT_LIGHT') for n in source.node_tree.nodes):
        warn(f'Light "{thing.name}": its nodes are ignored')
    if source.type == 'SUN':
        return made | {'type': 'directional', 'direction': turned(axis), 'irradiance': power}
    if source.type == 'AREA':
        size = matrix.to_scale()
        width = source.size * size.x
        height = (source.size_y if source.shape in ('RECTANGLE', 'ELLIPSE') else source.size) * size.y
        made |= {'at': turned(at), 'to': turned(at + axis), 'up': up}
        if source.shape in ('DISK', 'ELLIPSE'):
            if abs(width - height) > 1e-4 * width:
                warn(f'Light "{thing.name}": its ellipse becomes a disc of the same area')
            area = math.pi * width * height / 4
            return made | {'type': 'disc', 'radius': math.sqrt(area / math.pi), 'radiance': [p / (4 * area) for p in power]}
        return made | {'type': 'rect', 'width': width, 'height': height, 'radiance': [p / (4 * width * height) for p in power]}
    made |= {'at': turned(at), 'intensity': [p / (4 * math.pi) * metres * metres for p in power]}
    if source.type == 'POINT':
        return made | {'type': 'point'}
    cone = math.degrees(source.spot_size)
    return made | {'type': 'spot', 'to': turned(at + axis), 'up': up, 'cone_deg': cone, 'inner_deg': cone * (1 - source.spot_blend)}


def world(scene, folder, warn):
    """Its light, or None where it is black."""
    w = scene.world
    if not w:
        return None
    node = next((n for n in w.node_tree.nodes if n.type == 'BACKGROUND'), None) if w.use_nodes and w.node_tree else None
    strength = node.inputs['Strength'].default_value if node else 1.0
    tint = list(node.inputs['Color'].default_value if node else w.color)[:3]
    source = node.inputs['Color'].links[0].from_node if node and node.inputs['Color'].is_linked else None
    if source and source.type == 'TEX_ENVIRONMENT' and source.image and source.projection == 'EQUIRECTANGULAR':
        turn = 0.0
        mapping = source.inputs['Vector'].links[0].from_node if source.inputs['Vector'].is_linked else None
        if mapping and mapping.type == 'MAPPING':
            turn = math.degrees(mapping.inputs['Rotation'].default_value[2])
            if any(mapping.inputs['Rotation'].default_value[:2]):
                warn(f'World "{w.name}": only its rotation about z is used')
        path = os.path.join(folder, 'world.exr')
        save_linear(source.image, path, scene)
        return {'type': 'environment', 'image': 'world.exr', 'scale': strength, 'rotate_deg': -90.0 - turn}
    if source:
        warn(f'World "{w.name}": "{source.name}" is no equirectangular image; the colour of its background is used')
    if strength <= 0 or not any(tint):
        return None
    return {'type': 'environment', 'color': tint, 'scale': strength}


def save_linear(image, path, scene):
    """Saved as a copy, so that the user's image keeps its path."""
    if not image.has_data and not len(image.pixels):
        raise Trouble(f'The image "{image.name}" of the world can\'t be read')
    settings = scene.render.image_settings
    kept = settings.file_format, settings.color_depth
    try:
        settings.file_format, settings.color_depth = 'OPEN_EXR', '32'
        image.save_render(path, scene=scene)
    finally:
        settings.file_format, settings.color_depth = kept


# --- The whole scene ------------------------------------------------------------------------------------------------------------------

def chosen(context):
    """The selected shapes, or all visible ones."""
    visible = [o for o in context.view_layer.objects if o.visible_get() and not o.hide_render and o.type in SHAPES]
    objects = [o for o in visible if o.select_get()] or visible
    if not objects:
        raise Trouble('No mesh, curve or text is visible: there is nothing to send')
    return objects


def export_mesh(context, objects, path):
    """glTF has no unit but the metre, and the exporter writes Blender's units: the scene file has the factor."""
    if not hasattr(bpy.types, 'EXPORT_SCENE_OT_gltf'):
        bpy.ops.preferences.addon_enable(module='io_scene_gltf2')
    before, active = list(context.selected_objects), context.view_layer.objects.active
    wanted = {'filepath': path, 'export_format': 'GLB', 'use_selection': True, 'export_apply': True, 'export_animations': False,
              'export_skins': False, 'export_morph': False, 'export_cameras': False, 'export_lights': False, 'export_yup': True,
              'will_save_settings': False}
    known = {p.identifier for p in bpy.ops.export_scene.gltf.get_rna_type().properties}
    try:
        for thing in before:
            thing.select_set(False)
        for thing in objects:
            thing.select_set(True)
        bpy.ops.export_scene.gltf(**{k: v for k, v in wanted.items() if k in known})
    finally:
        for thing in objects:
            thing.select_set(False)
        for thing in before:
            thing.select_set(True)
        context.view_layer.objects.active = active


def scene_file(context, folder, warn):
    """Writes scene.glb and returns the scene file's content, which refers to it."""
    scene = context.scene
    metres = scene.unit_settings.scale_length
    if not 1e-6 <= metres * 1000 <= 1e9:
        raise Trouble(f'The unit scale of scene "{scene.name}" is {metres:g}, allowed: [1e-9, 1e6]')
    objects = chosen(context)
    made = {'pellucid': 1, 'mesh': 'scene.glb', 'unit': f'{metres * 1000:.9g}mm', 'camera': camera(scene, warn)}
    lights = [light(o, metres, warn) for o in context.view_layer.objects if o.type == 'LIGHT' and o.visible_get() and not o.hide_render]
    around = world(scene, folder, warn)
    made['lights'] = lights + ([around] if around else [])
    made['background'] = 'transparent' if scene.render.film_transparent else 'environment' if around else {'color': [0, 0, 0]}
    made['materials'] = entries(objects, metres * 1000, warn)
    percent = scene.render.resolution_percentage / 100
    settings = scene.pellucid
    made['render'] = {'method': settings.method, 'msaa': settings.msaa, 'width': max(1, int(scene.render.resolution_x * percent)),
                      'height': max(1, int(scene.render.resolution_y * percent)), 'dof': 'focus' in made['camera']}
    export_mesh(context, objects, os.path.join(folder, 'scene.glb'))
    return made
