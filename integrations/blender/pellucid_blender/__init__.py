# SPDX-License-Identifier: MIT
"""Renders with Pellucid from Blender: the panel "Pellucid" of the render properties, and of each material."""
import json
import os
import subprocess
import tempfile

import bpy

from . import convert, picture, program
from .program import Trouble

bl_info = {'name': 'Pellucid', 'author': 'The Pellucid authors', 'version': (0, 1, 0), 'blender': (3, 4, 0), 'category': 'Render',
           'location': 'Properties > Render > Pellucid; Properties > Material > Pellucid',
           'description': 'Renders translucent objects by pellucid, and brings the result back as an image'}
IMAGE = 'Pellucid'
listed = {} # built-in materials and methods, and the program that they came from
viewers = [] # (process, folder) of open viewers


def wanted_program(context):
    addon = context.preferences.addons.get(__name__)
    return addon.preferences.program if addon else ''


def names(kind, context, typed):
    """Names, of materials or methods, that contain the typed text; the program is queried once."""
    try:
        path = program.find(wanted_program(context))
        if listed.get(kind, ('', []))[0] != path:
            listed[kind] = path, program.names(path, kind)
    except (Trouble, OSError, subprocess.SubprocessError):
        return [] # a render reports the reason
    return [(name, title) for name, title in listed[kind][1] if typed.lower() in name]


def presets(_self, context, typed):
    return names('materials', context, typed)


def methods(_self, context, typed):
    return names('methods', context, typed)


class PellucidPreferences(bpy.types.AddonPreferences):
    bl_idname = __name__
    program: bpy.props.StringProperty(name='Program', subtype='FILE_PATH', description='The program pellucid; empty: the first of PATH')

    def draw(self, _context):
        self.layout.prop(self, 'program')


class PellucidScene(bpy.types.PropertyGroup):
    method: bpy.props.StringProperty(name='Method', default='screen-space', search=methods, description='A name of "pellucid methods"')
    msaa: bpy.props.IntProperty(name='Samples', default=4, min=1, max=64, description='Samples per pixel')


class PellucidMaterial(bpy.types.PropertyGroup):
    source: bpy.props.EnumProperty(name='Medium', items=[
        ('PRINCIPLED', 'Principled', 'Subsurface colour, radius and scale of the Principled node become coefficients'),
        ('PRESET', 'Built-in', 'A built-in material of Pellucid'), ('OPAQUE', 'Opaque', 'No light passes below the surface')])
    preset: bpy.props.StringProperty(name='Material', default='marble', search=presets, description='A name of "pellucid materials"')


def prepare(context, report, folder):
    """Program, and its scene file in the folder."""
    path = program.find(wanted_program(context))
    made = convert.scene_file(context, folder, lambda text: report({'WARNING'}, text))
    with open(os.path.join(folder, 'scene.json'), 'w', encoding='utf-8') as file:
        json.dump(made, file, indent=2)
    return path


class RENDER_OT_pellucid(bpy.types.Operator):
    """Renders the selected objects (all, if none is selected) with the scene's lights and camera into the image "Pellucid"; Esc cancels"""
    bl_idname = 'render.pellucid'
    bl_label = 'Render with Pellucid'

    def begin(self, context):
        self.folder = tempfile.TemporaryDirectory(prefix='pellucid-')
        self.path = prepare(context, self.report, self.folder.name)
        self.process = program.start(self.path, ['render', 'scene.json', '-o', 'picture.pfm'], self.folder.name, subprocess.DEVNULL)

    def end(self, context):
        for line in program.finish(self.process, self.folder.name):
            self.report({'WARNING'}, line.partition(': ')[2])
        if context.scene.render.film_transparent: # alpha needs no scattering, and PFM has none
            plain = ['-m', 'none', '--bounces', '0', '--light-samples', '1']
            covered = program.start(self.path, ['render', 'scene.json', *plain, '-o', 'alpha.png'], self.folder.name, subprocess.DEVNULL)
            covered.wait()
            program.finish(covered, self.folder.name)
        image = picture.show(self.folder.name, IMAGE)
        self.report({'INFO'}, f'The result is in the image "{image.name}"')

    def attempt(self, step, context):
        """Whether the run succeeded. Errors are reported, and the folder is removed."""
        try:
            step(context)
            return True
        except Trouble as fault:
            self.report({'ERROR'}, str(fault))
            self.folder.cleanup()
            return False

    def execute(self, context):
        done = self.attempt(self.begin, context)
        if done:
            self.process.wait()
            done = self.attempt(self.end, context)
        self.folder.cleanup()
        return {'FINISHED'} if done else {'CANCELLED'}

    def invoke(self, context, _event):
        if not self.attempt(self.begin, context):
            return {'CANCELLED'}
        self.timer = context.window_manager.event_timer_add(0.1, window=context.window)
        context.window_manager.modal_handler_add(self)
        context.workspace.status_text_set('Pellucid renders; Esc cancels')
        return {'RUNNING_MODAL'}

    def modal(self, context, event):
        if event.type == 'ESC' and event.value == 'PRESS':
            self.process.terminate()
            self.process.wait()
            self.leave(context)
            self.report({'WARNING'}, 'Cancelled')
            return {'CANCELLED'}
        if event.type != 'TIMER' or self.process.poll() is None:
            return {'PASS_THROUGH'}
        done = self.attempt(self.end, context)
        self.leave(context)
        return {'FINISHED'} if done else {'CANCELLED'}

    def leave(self, context):
        context.window_manager.event_timer_remove(self.timer)
        context.workspace.status_text_set(None)
        self.folder.cleanup()


class RENDER_OT_pellucid_view(bpy.types.Operator):
    """Opens the objects in the browser by "pellucid view"; it ends ten minutes after its page is closed, or with Blender"""
    bl_idname = 'render.pellucid_view'
    bl_label = 'Open in the viewer'

    def execute(self, context):
        folder = tempfile.TemporaryDirectory(prefix='pellucid-')
        try:
            path = prepare(context, self.report, folder.name)
            process = program.start(path, ['view', 'scene.json', *(['--no-open'] if bpy.app.background else [])], folder.name,
                                    subprocess.DEVNULL)
            try:
                process.wait(0.5)
                program.finish(process, folder.name)
            except subprocess.TimeoutExpired:
                pass
        except Trouble as fault:
            self.report({'ERROR'}, str(fault))
            folder.cleanup()
            return {'CANCELLED'}
        viewers.append((process, folder))
        return {'FINISHED'}


class RENDER_PT_pellucid(bpy.types.Panel):
    bl_label = 'Pellucid'
    bl_space_type, bl_region_type, bl_context = 'PROPERTIES', 'WINDOW', 'render'

    def draw(self, context):
        settings, layout = context.scene.pellucid, self.layout
        layout.use_property_split = True
        layout.prop(settings, 'method')
        layout.prop(settings, 'msaa')
        layout.operator('render.pellucid', icon='RENDER_STILL')
        layout.operator('render.pellucid_view', icon='URL')


class MATERIAL_PT_pellucid(bpy.types.Panel):
    bl_label = 'Pellucid'
    bl_order = 5 # after the surface, before "Viewport Display"
    bl_space_type, bl_region_type, bl_context = 'PROPERTIES', 'WINDOW', 'material'

    @classmethod
    def poll(cls, context):
        return context.material is not None

    def draw(self, context):
        settings, layout = context.material.pellucid, self.layout
        layout.use_property_split = True
        layout.prop(settings, 'source')
        if settings.source == 'PRESET':
            layout.prop(settings, 'preset')


CLASSES = [PellucidPreferences, PellucidScene, PellucidMaterial, RENDER_OT_pellucid, RENDER_OT_pellucid_view, RENDER_PT_pellucid,
           MATERIAL_PT_pellucid]


def register():
    for part in CLASSES:
        bpy.utils.register_class(part)
    bpy.types.Scene.pellucid = bpy.props.PointerProperty(type=PellucidScene)
    bpy.types.Material.pellucid = bpy.props.PointerProperty(type=PellucidMaterial)


def unregister():
    for process, folder in viewers:
        process.terminate()
        process.wait()
        folder.cleanup()
    viewers.clear()
    del bpy.types.Material.pellucid, bpy.types.Scene.pellucid
    for part in reversed(CLASSES):
        bpy.utils.unregister_class(part)
