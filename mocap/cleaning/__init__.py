"""Cleaning: what is not believed in a recording, put right or marked, and the noise of what is.

A recording comes in, pixels or positions. It goes out with positions, their deviations, and a reason for every sample
that is not believed. It touches no file.
"""
