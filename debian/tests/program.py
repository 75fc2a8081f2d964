# SPDX-License-Identifier: MIT
"""A Python program that knows the installed package alone: a tetrahedron of wax."""
import numpy as np

import pellucid

corners = np.array([(0, 0, 0), (20, 0, 0), (0, 20, 0), (0, 0, 20)], float)
faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
with pellucid.Scene.from_arrays([{"vertices": corners, "triangles": faces}], [{"preset": "wholemilk"}]) as scene:
    picture = pellucid.render(scene, size=(64, 48))
    assert picture.rgb.shape == (48, 64, 3) and picture.rgb.max() > 0
total = pellucid.total_reflectance(0.01, np.linspace(1, 5, 9))
assert (np.diff(total) > 0).all()
print(pellucid.version(), picture)
