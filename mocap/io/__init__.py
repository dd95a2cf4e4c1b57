"""File formats; pixels, degrees, millimetres and axis flips live here and nowhere deeper.

Paths come in. Contents in metres and in one convention go out, with a sentence on all that was assumed; and files that
are replaced whole or not at all. It touches the disk, and no file that is not ours is overwritten.
"""
