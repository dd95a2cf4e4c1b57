"""Reference of the variables of a recording, from the table that the code declares."""

from docs.tools.house import parts
from mocap.variables import VARIABLES

HEAD = """# The record

A recording is one `xarray.Dataset`, `Recording.data`, from `mocap.read` on; `mocap.clean` and `mocap.track` add to it,
`save` writes it as `recording.nc`, and `mocap.load` reads that. Dimensions have the names of movement: `view` is a
camera, `keypoint` a marker. Arrays are read-only; a step returns a new recording.

```python
rec = mocap.clean(mocap.read("bat_xypts.csv", calibration="dltCoefs.csv", fps=700))
rec.data["position"].sel(keypoint="wrist_l")  # NaN where nothing is believed
rec.data["rejected"].sum(["time", "keypoint"])  # how many samples were rejected, for each reason
res = mocap.track(rec)
res.data["velocity"].sel(point="wrist_l")  # of the smoothed position
```

| variable | dimensions | unit | since | meaning |
|---|---|---|---|---|
"""
FOOT = """
Coordinates: `time` (s), `frame` (as the file counts), `keypoint`, `view`, `reason`, `point`, `joint`, `angle`,
`segment`, `limb`. Attributes: `fps`, `space_unit`, `format`, `y_up` (whether pixel rows count upwards); since `track`
`model`. `Tracked.markers` is the part of it that movement has, in movement's layout ([files](files.md)).

What no array holds is in parts, each of the step that found it: `rec[Part]`, or a `MocapError` that says before which
step it is not known. They are cut with the recording, saved and loaded with it, and `rec.findings` is what they tell.

{parts}

`rec.source` is what the user gave: files, calibration, stated unit and noise.
"""


def page() -> str:
    """All variables, in Markdown."""
    rows = (
        f"| `{name}` | {', '.join(told.dims)} | {told.unit} | `{told.since}` | {told.meaning} |"
        for name, told in VARIABLES.items()
    )
    held = ["| part | of | holds |", "|---|---|---|"]
    held += [f"| `{kind}` | `{step}` | {told} |" for _, kind, step, told in parts()]
    return HEAD + "\n".join(rows) + "\n" + FOOT.replace("{parts}", "\n".join(held))
