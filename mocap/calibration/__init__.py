"""Calibration: cameras from images of boards, wands, known points, or the marker tracks themselves.

Images and files of known things come in, or a recording. Cameras with their lenses and residuals go out, and files of
them, or an error that says what is implausible. It touches the files that are given and the result folder.
"""
