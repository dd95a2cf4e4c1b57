"""The files of a result that a program reads back."""

RECORDING, MARKERS, SKELETON = "recording.nc", "markers.nc", "skeleton.toml"
