"""Where rows of pixels are counted from."""

from typing import Literal

PixelCorner = Literal["upper-left", "lower-left"]
"""Of an image, that rows of pixels are counted from."""
