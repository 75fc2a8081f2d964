#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_blender_operators.py PROGRAM ROOT: how the add-on's operators end, with a stand-in for Blender and one for the program.

test_blender.py runs the add-on in Blender, where it is installed; there Esc, closed windows and programs that hang can't be tried."""
import os
import sys
import time
import types

from cli_test import ROOT, main, need, test

TIMERS = []


class Anything:
    """Any attribute, call or index of Blender that the operators don't need."""

    def __init__(self, **known):
        self.__dict__.update(known)

    def __getattr__(self, name):
        return Anything()

    def __call__(self, *_words, **_named):
        return Anything()


class Operator:
    said = ()

    def report(self, kinds, text):
        self.said = [*self.said, (*kinds, text)]


class Timers:
    @staticmethod
    def is_registered(function):
        return function in TIMERS

    @staticmethod
    def register(function, first_interval):
        TIMERS.append(function)

    @staticmethod
    def unregister(function):
        TIMERS.remove(function)


def load(folder, script):
    """The add-on, fresh, with a program that is the shell script."""
    program = folder / 'pellucid'
    program.write_text('#!/bin/sh\n' + script)
    program.chmod(0o755)
    empty = type('Empty', (), {})
    bpy = types.ModuleType('bpy')
    bpy.types = types.SimpleNamespace(Operator=Operator, AddonPreferences=empty, PropertyGroup=empty, Panel=empty, Scene=empty(),
                                      Material=empty())
    bpy.props, bpy.utils = Anything(), Anything()
    bpy.app = types.SimpleNamespace(background=True, version=(3, 4, 0), timers=Timers)
    bpy.context = context(program)
    TIMERS.clear()
    for name in [n for n in sys.modules if n.startswith('pellucid_blender')]:
        del sys.modules[name]
    sys.modules |= {'bpy': bpy, 'numpy': types.ModuleType('numpy'), 'mathutils': types.SimpleNamespace(Vector=None)}
    sys.path[:0] = [] if str(ROOT / 'integrations/blender') in sys.path else [str(ROOT / 'integrations/blender')]
    sys.dont_write_bytecode = True
    addon = __import__('pellucid_blender')
    addon.convert.scene_file = lambda *_words: {'pellucid': 1}
    addon.picture.show = lambda folder, name: types.SimpleNamespace(name=','.join(sorted(os.listdir(folder))))
    return addon, bpy.context


def context(program, transparent=False):
    preferences = types.SimpleNamespace(program=str(program))
    return types.SimpleNamespace(
        preferences=types.SimpleNamespace(addons={'pellucid_blender': types.SimpleNamespace(preferences=preferences)}),
        scene=types.SimpleNamespace(render=types.SimpleNamespace(film_transparent=transparent)), window=None,
        window_manager=Anything(event_timer_add=lambda *_words, **_named: 'timer'), workspace=Anything())


def event(kind):
    return types.SimpleNamespace(type=kind, value='PRESS')


def pump(operator, where):
    """Timer events until the operator ends; and the longest time that one took."""
    longest = 0
    for _ in range(200):
        start = time.monotonic()
        answer = operator.modal(where, event('TIMER'))
        longest = max(longest, time.monotonic() - start)
        if answer != {'PASS_THROUGH'}:
            return answer, longest
        time.sleep(0.02)
    return {'HANGS'}, longest


WRITES = 'for last; do :; done; sleep 0.3; echo x >"$last"\n'


@test('a transparent film renders twice, and waits for neither')
def _(folder):
    addon, where = load(folder, WRITES)
    where.scene.render.film_transparent = True
    operator = addon.RENDER_OT_pellucid()
    need(operator.invoke(where, None) == {'RUNNING_MODAL'}, operator.said)
    answer, longest = pump(operator, where)
    need(answer == {'FINISHED'} and longest < 0.25, answer, longest, operator.said)
    need('alpha.png' in operator.said[-1][1] and 'picture.pfm' in operator.said[-1][1], operator.said)
    again = addon.RENDER_OT_pellucid()
    need(again.execute(where) == {'FINISHED'} and 'alpha.png' in again.said[-1][1], again.said)


@test('Esc and the end of Blender end the program and remove its folder; one render runs at a time')
def _(folder):
    addon, where = load(folder, 'exec sleep 60\n')
    for end in (lambda o: o.modal(where, event('ESC')), lambda o: o.cancel(where), lambda _o: addon.unregister()):
        operator, second = addon.RENDER_OT_pellucid(), addon.RENDER_OT_pellucid()
        operator.invoke(where, None)
        process, kept = operator.process, operator.folder.name
        need(second.invoke(where, None) == {'CANCELLED'} and second.execute(where) == {'CANCELLED'}, second.said)
        need('already' in second.said[0][1] and process.poll() is None and os.path.isdir(kept), second.said)
        addon.bpy.types.Scene.pellucid = addon.bpy.types.Material.pellucid = None # register's
        end(operator)
        need(process.poll() is not None and not os.path.exists(kept), 'left behind', kept)
        need(not addon.rendering, addon.rendering)


@test('any failure is reported, and the next render runs')
def _(folder):
    addon, where = load(folder, WRITES)
    show, written = addon.picture.show, addon.convert.scene_file

    def fails(*_words):
        raise RuntimeError('no memory')
    for place, name, keep in ((addon.picture, 'show', show), (addon.convert, 'scene_file', written)):
        setattr(place, name, fails)
        operator = addon.RENDER_OT_pellucid()
        need(operator.execute(where) == {'CANCELLED'}, operator.said)
        need(operator.said == [('ERROR', 'Pellucid failed: RuntimeError: no memory')], operator.said)
        setattr(place, name, keep)
    (folder / 'pellucid').write_text('#!/bin/sh\nkill -9 $$\n')
    operator = addon.RENDER_OT_pellucid()
    need(operator.execute(where) == {'CANCELLED'} and 'signal 9' in operator.said[0][1], operator.said)
    (folder / 'pellucid').write_text('#!/bin/sh\n' + WRITES)
    operator = addon.RENDER_OT_pellucid()
    need(operator.execute(where) == {'FINISHED'}, operator.said)


@test('a viewer that ends later is forgotten, and said where it failed')
def _(folder):
    addon, where = load(folder, 'sleep 1; echo "error: the port is taken" >&2; exit 1\n')
    said = []
    addon.complain = said.append
    need(addon.RENDER_OT_pellucid_view().execute(where) == {'FINISHED'}, 'the viewer')
    kept = addon.viewers[0][1].name
    need(addon.watch_viewers in TIMERS and addon.watch_viewers() == 1.0, TIMERS)
    addon.viewers[0][0].wait()
    need(addon.watch_viewers() is None and not addon.viewers and not os.path.exists(kept), addon.viewers)
    need(len(said) == 1 and 'the port is taken' in said[0], said)


@test('a program that hangs does not hold up a search for names')
def _(folder):
    addon, where = load(folder, 'sleep 3; echo "{\\"materials\\": [{\\"name\\": \\"marble\\", \\"title\\": \\"Marble\\"}]}"\n')
    start = time.monotonic()
    need(addon.presets(None, where, 'mar') == [] and time.monotonic() - start < 1.5, time.monotonic() - start)
    start = time.monotonic()
    need(addon.presets(None, where, 'mar') == [] and time.monotonic() - start < 0.4, time.monotonic() - start)
    time.sleep(3.5)
    need(addon.presets(None, where, 'MAR') == [('marble', 'Marble')], addon.queries)


if __name__ == '__main__':
    sys.exit(main())
