"""Motion models: what a tracker believes between two frames."""
