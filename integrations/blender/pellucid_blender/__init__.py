# SPDX-License-Identifier: MIT
"""Renders with Pellucid from Blender: the panel "Pellucid" of the render properties, and of each material."""
import json
import os
import subprocess
import tempfile
import traceback

import bpy

from . import convert, picture, program
from .program import Trouble

bl_info = {'name': 'Pellucid', 'author': 'The Pellucid authors', 'version': (0, 1, 0), 'blender': (3, 4, 0), 'category': 'Render',
           'location': 'Properties > Render > Pellucid; Properties > Material > Pellucid',
           'description': 'Renders translucent objects by pellucid, and brings the result back as an image'}
IMAGE = 'Pellucid'
queries = {} # (program, kind): program.Names, which asks for the built-in materials or methods
viewers = [] # (process, folder) of open viewers
rendering = [] # the operator that renders, one at most
PATIENCE = 0.5 # s, for names when they are asked for first: after that they are shown when they are there


def wanted_program(context):
    addon = context.preferences.addons.get(__name__)
    return addon.preferences.program if addon else ''


def said_of(fault):
    """What a user reads about any failure. The whole of one that is not the user's is in the console."""
    if isinstance(fault, Trouble):
        return str(fault)
    traceback.print_exception(type(fault), fault, fault.__traceback__)
    return f'Pellucid failed: {type(fault).__name__}: {fault}'


def names(kind, context, typed):
    """Names, of materials or methods, that contain the typed text; the program is queried once, and never waited for."""
    try:
        path = program.find(wanted_program(context))
    except Trouble:
        return [] # a render reports the reason
    query = queries.get((path, kind))
    if query is None or (query.found is None and not query.is_alive()):
        query = queries[path, kind] = program.Names(path, kind)
        query.start()
        query.join(PATIENCE)
    return [(name, title) for name, title in query.found or [] if typed.lower() in name]


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

    process = timer = None

    def begin(self, context):
        self.folder = tempfile.TemporaryDirectory(prefix='pellucid-')
        self.path = prepare(context, self.report, self.folder.name)
        self.runs = [['-o', 'picture.pfm']]
        if context.scene.render.film_transparent: # alpha needs no scattering, and PFM has none
            self.runs.append(['-m', 'none', '--bounces', '0', '--light-samples', '1', '-o', 'alpha.png'])
        self.start_next()

    def start_next(self):
        self.process = program.start(self.path, ['render', 'scene.json', *self.runs[0]], self.folder.name, subprocess.DEVNULL)

    def step(self, context):
        """A run has ended: the next begins, or the image is shown."""
        warnings = program.finish(self.process, self.folder.name)
        for line in warnings if self.runs[0][-1] == 'picture.pfm' else []:
            self.report({'WARNING'}, line.partition(': ')[2])
        del self.runs[0]
        if self.runs:
            self.start_next()
            return
        image = picture.show(self.folder.name, IMAGE)
        self.report({'INFO'}, f'The result is in the image "{image.name}"')

    def attempt(self, step, context):
        """Whether a step succeeded. Any failure is reported, and ends the render."""
        try:
            step(context)
            return True
        except Exception as fault: # pylint: disable=broad-except
            self.report({'ERROR'}, said_of(fault))
            self.leave(context)
            return False

    def busy(self):
        if rendering:
            self.report({'ERROR'}, 'Pellucid renders already: wait for it, or press Esc in its window')
            return True
        rendering.append(self)
        self.folder, self.runs = None, []
        return False

    def execute(self, context):
        if self.busy():
            return {'CANCELLED'}
        done = self.attempt(self.begin, context)
        while done and self.runs:
            self.process.wait()
            done = self.attempt(self.step, context)
        self.leave(context)
        return {'FINISHED'} if done else {'CANCELLED'}

    def invoke(self, context, _event):
        if self.busy() or not self.attempt(self.begin, context):
            return {'CANCELLED'}
        self.timer = context.window_manager.event_timer_add(0.1, window=context.window)
        context.window_manager.modal_handler_add(self)
        context.workspace.status_text_set('Pellucid renders; Esc cancels')
        return {'RUNNING_MODAL'}

    def modal(self, context, event):
        if event.type == 'ESC' and event.value == 'PRESS':
            self.leave(context)
            self.report({'WARNING'}, 'Cancelled')
            return {'CANCELLED'}
        if event.type != 'TIMER' or self.process.poll() is None:
            return {'PASS_THROUGH'}
        if not self.attempt(self.step, context):
            return {'CANCELLED'}
        if self.runs:
            return {'PASS_THROUGH'}
        self.leave(context)
        return {'FINISHED'}

    def cancel(self, context):
        """Blender ends, or loads another file."""
        self.leave(context)

    def leave(self, context):
        """Ends the program and the display, wherever the render is; twice is once."""
        program.stop(self.process)
        self.process = None
        if self.timer:
            context.window_manager.event_timer_remove(self.timer)
            self.timer = None
            if context.workspace: # none while Blender ends
                context.workspace.status_text_set(None)
        if self.folder:
            self.folder.cleanup()
            self.folder = None
        if self in rendering:
            rendering.remove(self)


def complain(text):
    """Shows a failure when no operator is there to report it."""
    print(text)
    context = bpy.context
    if not bpy.app.background and context.window_manager:
        context.window_manager.popup_menu(lambda menu, _context: menu.layout.label(text=text), title='Pellucid', icon='ERROR')


def watch_viewers():
    """A timer: forgets viewers that have ended, and says why where that is a failure. Seconds to the next time; None: no viewer is left."""
    for entry in list(viewers):
        process, folder = entry
        if process.poll() is None:
            continue
        viewers.remove(entry)
        try:
            program.finish(process, folder.name)
        except Exception as fault: # pylint: disable=broad-except
            complain('The viewer has ended: ' + said_of(fault))
        folder.cleanup()
    return 1.0 if viewers else None


class RENDER_OT_pellucid_view(bpy.types.Operator):
    """Opens the objects in the browser by "pellucid view"; it ends ten minutes after its page is closed, or with Blender"""
    bl_idname = 'render.pellucid_view'
    bl_label = 'Open in the viewer'

    def execute(self, context):
        folder = process = None
        try:
            folder = tempfile.TemporaryDirectory(prefix='pellucid-')
            path = prepare(context, self.report, folder.name)
            process = program.start(path, ['view', 'scene.json', *(['--no-open'] if bpy.app.background else [])], folder.name,
                                    subprocess.DEVNULL)
            try:
                process.wait(0.5)
                program.finish(process, folder.name)
            except subprocess.TimeoutExpired:
                pass
        except Exception as fault: # pylint: disable=broad-except
            self.report({'ERROR'}, said_of(fault))
            program.stop(process)
            if folder:
                folder.cleanup()
            return {'CANCELLED'}
        viewers.append((process, folder))
        if not bpy.app.timers.is_registered(watch_viewers):
            bpy.app.timers.register(watch_viewers, first_interval=1.0)
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
    for operator in list(rendering):
        operator.leave(bpy.context)
    if bpy.app.timers.is_registered(watch_viewers):
        bpy.app.timers.unregister(watch_viewers)
    for process, folder in viewers:
        program.stop(process)
        folder.cleanup()
    viewers.clear()
    del bpy.types.Material.pellucid, bpy.types.Scene.pellucid
    for part in reversed(CLASSES):
        bpy.utils.unregister_class(part)
