# SPDX-License-Identifier: MIT
"""Loads the output of `pellucid render` as an image of Blender. The image is read from PFM, linear floats: Blender 3.4 gives a script no
access to the pixels of an EXR with layers."""
import os

import bpy
import numpy

from .program import Trouble


def read(path):
    """Rows from the bottom, in Blender's order: R, G, B."""
    with open(path, 'rb') as file:
        data = file.read()
    try:
        kind, size, scale, rest = data.split(b'\n', 3)
        width, height = (int(n) for n in size.split())
        if kind != b'PF':
            raise ValueError('its first line is no "PF"')
        made = numpy.frombuffer(rest, '<f4' if float(scale) < 0 else '>f4', 3 * width * height)
    except ValueError as fault:
        raise Trouble(f'{path} is no PFM of three channels: {fault}') from fault
    return made.reshape(height, width, 3)


def alpha(path, shape):
    """Alpha of a PNG of the same size."""
    image = bpy.data.images.load(path)
    try:
        if (image.size[1], image.size[0]) != shape:
            raise Trouble(f'{path} has {image.size[0]} x {image.size[1]} pixels, expected {shape[1]} x {shape[0]}')
        made = numpy.empty(len(image.pixels), numpy.float32)
        image.pixels.foreach_get(made)
        return made.reshape(*shape, 4)[:, :, 3]
    finally:
        bpy.data.images.remove(image)


def show(folder, name):
    """Loads picture.pfm, with the alpha of alpha.png if there is one, into the image of that name. It is linear: Blender's view
    transform applies to it."""
    rgb = read(os.path.join(folder, 'picture.pfm'))
    height, width = rgb.shape[:2]
    over = os.path.join(folder, 'alpha.png')
    pixels = numpy.ones((height, width, 4), numpy.float32)
    pixels[:, :, :3] = rgb
    if os.path.exists(over):
        pixels[:, :, 3] = alpha(over, (height, width))
    old = bpy.data.images.get(name)
    if old:
        old.name = name + ' (old)'
    image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=True)
    if old:
        old.user_remap(image)
        bpy.data.images.remove(old)
    image.alpha_mode = 'PREMUL'
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()
    return image
