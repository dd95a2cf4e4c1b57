"""Results are written whole, but for the ink of their figures."""

import pytest

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
