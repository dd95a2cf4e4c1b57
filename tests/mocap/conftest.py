"""Results are written whole, but for the ink of their figures; sound HDF5 is read without a process of its own."""

import pytest

from mocap.io import head
from mocap.io.bounds import most_bytes
from mocap.io.hdf5_process import names
from mocap.plots import figures


@pytest.fixture(autouse=True, scope="module")
def figures_without_ink(request):
    """Figures are built but not drawn, which takes half of the time of a result: but where a file looks at them.

    Such a file says ``INK = True``.
    """
    with pytest.MonkeyPatch.context() as patch:
        if not getattr(request.module, "INK", False):
            patch.setattr(figures, "drawn", lambda _figure, kind: f"<{kind}/>".encode())
        yield


@pytest.fixture(scope="module")
def hdf5_here():
    """HDF5 files, none of which is damaged, are walked through in this process; another one takes 0.3 s to start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(head, "read_apart", lambda path, *_, **__: names(str(path), most_bytes(path)))
        yield
