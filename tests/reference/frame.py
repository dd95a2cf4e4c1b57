"""A planar frame of Euler-Bernoulli beams by the direct stiffness method (Przemieniecki 1968, section 5.6)."""

import numpy as np


def frame_response(points, *, young_pa, depth_m, thickness_m, force_n):
    """A chain of beams clamped at neither end: the first point held in x and y, the last in y and pulled along x.

    Returns:
        Travel of the last point along x, and the largest bending strain at any beam's end.
    """
    points = np.asarray(points, dtype=float)
    n = len(points)
    area, inertia = depth_m * thickness_m, depth_m * thickness_m**3 / 12
    total, turned = np.zeros((3 * n, 3 * n)), []
    for i in range(n - 1):
        way = points[i + 1] - points[i]
        length = np.linalg.norm(way)
        c, s = way / length
        a, b = young_pa * area / length, young_pa * inertia / length**3
        local = np.zeros((6, 6))
        local[np.ix_([0, 3], [0, 3])] = a * np.array([[1, -1], [-1, 1]])
        bend = [[12, 6 * length, -12, 6 * length], [6 * length, 4 * length**2, -6 * length, 2 * length**2]]
        bend += [[-12, -6 * length, 12, -6 * length], [6 * length, 2 * length**2, -6 * length, 4 * length**2]]
        local[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = b * np.array(bend)
        turn = np.kron(np.eye(2), np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
        rows = np.arange(3 * i, 3 * i + 6)
        total[np.ix_(rows, rows)] += turn.T @ local @ turn
        turned.append((rows, local, turn))
    free = np.setdiff1d(np.arange(3 * n), [0, 1, 3 * n - 2])
    force = np.zeros(3 * n)
    force[3 * n - 3] = force_n
    moved = np.zeros(3 * n)
    moved[free] = np.linalg.solve(total[np.ix_(free, free)], force[free])
    moments = [np.abs((local @ turn @ moved[rows])[[2, 5]]).max() for rows, local, turn in turned]
    return moved[3 * n - 3], max(moments) * thickness_m / 2 / (young_pa * inertia)
