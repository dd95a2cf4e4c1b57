"""aniposelib's optimisation of points, timed, in an environment that has it and nothing of ours.

``python anipose_runner.py PROBLEM.npz`` prints a line of JSON: the version, seconds of the processor without imports
and compilation, and the median reprojection error in pixels before and after. The problem has ``uv_px`` (C, T, M, 2),
``xyz_mm`` (T, M, 3) with NaN where two cameras see nothing, ``bones`` (B, 2), and each camera's ``matrix`` (C, 3, 3),
``rvec`` (C, 3) and ``tvec_mm`` (C, 3).
"""

import json
import sys
import time
from importlib.metadata import version

import numpy as np
from aniposelib.cameras import Camera, CameraGroup  # type: ignore[import-not-found]


def main() -> None:
    """Run the problem that is named."""
    problem = np.load(sys.argv[1])
    poses = zip(problem["matrix"], problem["rvec"], problem["tvec_mm"], strict=True)
    cameras = [Camera(matrix=matrix, rvec=rvec, tvec=tvec, name=str(i)) for i, (matrix, rvec, tvec) in enumerate(poses)]
    group, uv, xyz = CameraGroup(cameras), problem["uv_px"], problem["xyz_mm"]
    bones = problem["bones"].tolist()

    def error_px(points: np.ndarray) -> float:
        """Median distance of what is projected from what was seen."""
        found = group.project(points.reshape(-1, 3)).reshape(uv.shape)
        return float(np.nanmedian(np.linalg.norm(found - uv, axis=-1)))

    group.optim_points(uv[:, :12], xyz[:12], constraints=bones)  # compiles
    start = time.process_time()
    found = group.optim_points(uv, xyz, constraints=bones)
    taken = time.process_time() - start
    told = {"version": version("aniposelib"), "cpu_s": taken, "before_px": error_px(xyz), "after_px": error_px(found)}
    print(json.dumps(told))


if __name__ == "__main__":
    main()
