"""Tables of stated deviations: what single recordings spread by, beside what they are together."""

import numpy as np
import pandas as pd
import pytest

from benchmarks.deviations import cells


def test_single_recordings_are_told_beside_all_together():
    """Eleven recordings of z 0.5 to 1.5: together the root mean square, singly the quantiles, six within 0.7 to 1.4."""
    z = np.linspace(0.5, 1.5, 11)
    table = pd.DataFrame(
        {"recording": [f"bat {i}" for i in range(11)], "quantity": "velocity", "kind": "measured", "n": 100, "z": z}
    ).assign(inside=0.95)
    found = cells(table).set_index("animal").loc["all"]
    assert found.z == pytest.approx(np.sqrt(np.mean(z**2)))
    np.testing.assert_allclose(found[["z_10", "z_50", "z_90"]].astype(float), [0.6, 1.0, 1.4])
    assert found.right == ((z >= 0.7) & (z <= 1.4)).sum()
