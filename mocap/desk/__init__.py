"""The desk: trials of a folder go in, tracked and proof-read ones come out, all on one page of this computer.

What it does are calls of the library, each shown with the command that does the same. Nothing imports this room but the
command line. The page is one of ours (``mocap.web``) and not a toolkit's: those bring a socket server of their own,
which the guard does not stand before, and send each mark of a picture as an object; here a frame is one small answer.
"""
