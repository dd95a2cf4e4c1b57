"""From files to a recording: what they hold, and what they leave open decided.

Paths, arrays and edits come in. A recording goes out, with the corner, unit, rate, lens and lag that were decided. It
touches the files that it is given, and writes edits.
"""
