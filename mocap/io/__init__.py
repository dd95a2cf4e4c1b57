"""File formats; pixels, degrees, millimetres and axis flips live here and nowhere deeper."""
