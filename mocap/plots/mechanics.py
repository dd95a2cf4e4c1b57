"""Energy of a limb that was tracked by its own mechanics, and V_z below Theorem 3's bound."""

from matplotlib.figure import Figure

from mocap.filters.bodies import UNKNOWN_KG
from mocap.pipeline.limb_mechanics import LimbMechanics


def draw_mechanics(limb: LimbMechanics) -> Figure:
    """Energies over time, and V_z with the bound of a release at each instant."""
    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    top, low = figure.subplots(2, 1, sharex=True)
    t, track = limb.track.t_s, limb.track
    top.plot(t, 1e3 * track.energy_j, color="black", linewidth=1.2, label="T + V_z/ε²")
    top.plot(t, 1e3 * limb.kinetic_j, color="#56B4E9", linewidth=1.0, label="T = v·M(q)v/2")
    top.plot(t, 1e3 * limb.strength_j * track.value, color="#E69F00", linewidth=1.0, label="V_z/ε²")
    top.set_ylabel("energy (mJ)" if limb.stated else f"energy (mJ, for {UNKNOWN_KG:g} kg)")
    low.semilogy(t, track.value, color="#E69F00", linewidth=1.0, label="V_z of the track")
    low.semilogy(t, limb.bound, color="#D55E00", linewidth=1.0, linestyle="--", label="Theorem 3: released here")
    low.set_ylabel("V_z")
    low.set_xlabel("t (s)")
    for axes in (top, low):
        axes.fill_between(
            t, 0, 1, where=(~track.measured).tolist(), transform=axes.get_xaxis_transform(), color="0.9", linewidth=0
        )
        axes.grid(visible=True, alpha=0.3)
        axes.legend(fontsize=7, frameon=False, ncols=3)
    masses = "masses as stated" if limb.stated else "uniform rods of one density"
    top.set_title(f"{limb.name}: {len(limb.markers)} rods, {masses}, 1/ε² = {limb.strength_j:.3g} J", fontsize=9)
    return figure
