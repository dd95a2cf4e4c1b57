"""``mocap design-joint``: where the potential comes from, and the truss drawn, printed, shown and reported.

A potential of a joint comes in, from a result or a model file. A truss goes out, with its drawing, its parts to print
and its report. It touches the result folder.
"""

from eal.needs import needs

needs("designing joints", "joint-design", "jax", "trimesh", "manifold3d", "networkx")
