"""Reference of the variables of a recording, from the table that the code declares."""

from mocap.pipeline.variables import VARIABLES

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
`segment`, `limb`. Attributes: `fps`, `space_unit`, `format`; since `track` `model` and `y_up` (whether pixel rows count
upwards). `Tracked.markers` is the part of it that movement has, in movement's layout ([files](files.md)).
"""


def page() -> str:
    """All variables, in Markdown."""
    rows = (
        f"| `{name}` | {', '.join(told.dims)} | {told.unit} | `{told.since}` | {told.meaning} |"
        for name, told in VARIABLES.items()
    )
    return HEAD + "\n".join(rows) + "\n" + FOOT
