"""Results are written whole, but for what is there to be looked at; sound files are read without another process."""

import pickle
from functools import partial

import pytest
from matplotlib.figure import Figure

from mocap.io import apart
from mocap.io.apart import most_bytes
from mocap.plots import figures
from mocap.plots.figures import Picture
from mocap.rerun import record
from mocap.tracking import potentials

NONE = Figure()
CHOSEN = {}
"""What was chosen for which samples: many tests track the same recording, whose potentials take a third of it."""


def chosen_once(choose, samples, **options):
    """The same, of the very same samples, is looked for once."""
    key = pickle.dumps((samples, options))
    if key not in CHOSEN:
        CHOSEN[key] = choose(samples, **options)
    return CHOSEN[key]


@pytest.fixture(autouse=True, scope="module")
def without_pictures(request):
    """One figure is named and none drawn, and no recording for the viewer is made: they take most of a result's time.

    A file that looks at figures says ``INK = True``; what looks at recordings sets ``write_recording`` again.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(potentials, "choose", partial(chosen_once, potentials.choose))
        if not getattr(request.module, "INK", False):
            patch.setattr(figures, "drawn", lambda _figure, kind: f"<{kind}/>".encode())
            patch.setattr(figures, "pictures", lambda *_: [Picture(name="animal", caption="An animal.", figure=NONE)])
            patch.setattr(record, "write_recording", lambda _run, path, **_options: path.write_bytes(b"RRF2"))
        yield


@pytest.fixture(autouse=True, scope="module")
def read_here(request):
    """HDF5 and MATLAB files are read in this process, as another one takes half a second to start.

    What this one cannot read is left to the other; a file that damages them says ``DAMAGED = True``.
    """
    other = apart.read_apart

    def here(path, kind, **options):
        try:
            return pickle.dumps(apart.READERS[kind](str(path), most_bytes(path)))
        except Exception:
            return other(path, kind, **options)

    with pytest.MonkeyPatch.context() as patch:
        if not getattr(request.module, "DAMAGED", False):
            patch.setattr(apart, "read_apart", here)
        yield
