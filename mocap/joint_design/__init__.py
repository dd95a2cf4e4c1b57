"""``mocap design-joint``: where the potential comes from, and the truss drawn, printed, shown and reported."""

from eal.needs import needs

needs("designing joints", "joint-design", "jax", "trimesh", "manifold3d", "networkx")
