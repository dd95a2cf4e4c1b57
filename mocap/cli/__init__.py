"""The commands of ``mocap``, one in each file: their options and their output.

What a person typed comes in. Calls of the library go out, with the lines, exit codes and pages that tell of them. It
touches the terminal, and files through the rooms that write them.
"""
