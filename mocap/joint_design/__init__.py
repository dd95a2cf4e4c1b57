"""``mocap design-joint``: where the potential comes from, and the truss drawn, printed, shown and reported."""
