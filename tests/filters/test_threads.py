"""Libraries of BLAS are looked for once in a process, not in each pass of a filter."""

import numpy as np
import threadpoolctl
from mocap.filters.motion.constant_velocity import ConstantVelocity
from mocap.filters.observations import PositionObservations
from mocap.filters.track import smooth

from eal.threads import one_blas_thread


def test_a_pass_does_not_look_for_libraries(monkeypatch):
    """Looking through all that is loaded takes 20 to 80 ms: as long as ten frames, in each of a command's passes."""
    with one_blas_thread():
        pass

    def looked(*_args, **_options):
        raise AssertionError("looked again")

    monkeypatch.setattr(threadpoolctl.ThreadpoolController, "_load_libraries", looked)
    seen = PositionObservations(xyz_m=np.zeros((3, 1, 3)), sd_m=np.full((3, 1), 1e-3))
    model = ConstantVelocity(start_m=np.zeros((1, 3)), start_sd_m=1.0, speed_sd_m_s=1.0, density=np.ones(1))
    assert smooth(model, seen, np.arange(3) / 100).xyz_m.shape == (3, 1, 3)
