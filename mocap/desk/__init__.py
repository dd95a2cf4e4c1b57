"""The desk: trials are tracked and proof-read on one page of this computer.

Folders of trials come in. Results, edits and exports go out. It touches the folders that its user names.

What it does are calls of the library, each shown with the command that does the same. Nothing imports this room but the
command line. The page is one of ours (``mocap.web``) and not a toolkit's: those bring a socket server of their own,
which the guard does not stand before, and send each mark of an image as an object; here a frame is one small answer.
"""

import mocap.web  # noqa: F401 - which names the extra that pages need
