"""Where pixel rows are counted from, as a finding."""

from mocap.cameras.origin import PixelOrigin
from mocap.findings import Finding, Kind


def origin_finding(decision: PixelOrigin) -> Finding:
    """Where pixel rows are counted from; an alarm where that was found from their residual, and could be stated."""
    return Finding(
        kind=Kind.PIXEL_ORIGIN,
        alarm=decision.guessed,
        text=decision.describe(),
        numbers={"residual_px": decision.residual_px}
        | ({"next_px": decision.next_px} if decision.next_px < float("inf") else {}),
    )
