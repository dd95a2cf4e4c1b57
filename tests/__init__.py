"""A package, as sleap-io installs one of this name, which would hide a folder that is none."""
