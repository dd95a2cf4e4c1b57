"""What people call the motion models: names, titles, a few words on each; without the models, which load much.

``mocap.filters.models.registry`` has the models themselves by the same names.
"""

from mocap.filters.models.about import NamedModel

from eal.plugins import offered

OURS: dict[str, NamedModel[None]] = {
    "eal": NamedModel(None, "pose model", "Kalman smoother of the whole pose with its joint potentials"),
    "articulated": NamedModel(
        None, "joint angles", "Kalman smoother of joint angles, segments of constant length", beside=("eal",)
    ),
    "lagrangian": NamedModel(
        None, "Lagrangian", "joint angles moved by the forces of the animal's masses", beside=("eal", "articulated")
    ),
    "smooth_acceleration": NamedModel(
        None,
        "smooth acceleration",
        "Kalman smoother of each marker alone, as smooth, quick and noisy as the recording shows",
        posed=False,
        beside=("constant_velocity",),
    ),
    "constant_velocity": NamedModel(None, "constant velocity", "Kalman smoother of each marker alone", posed=False),
}
"""Those of this program, without their settings."""
ELSEWHERE: dict[str, NamedModel] = offered("mocap.models", NamedModel)
"""Those of other packages."""
TITLES: dict[str, NamedModel] = {**OURS, **ELSEWHERE}
"""All."""
