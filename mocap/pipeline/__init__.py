"""From the files of a recording to its tracked motion, potentials and report.

Paths, arrays or a recording come in. The recording goes out with what the step has added to it. It touches files in
reading, model files and edits alone; a recording that was read is tracked without any.
"""
