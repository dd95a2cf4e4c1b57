"""From video to tracks: dots found in windows that a filter predicts, named over all cameras, and clicks asked for.

Videos and a few clicks come in, or trajectories without names. Pixel tracks go out in files of DLTdv and our own, or
names with their probability. It touches the videos that are given and the result folder.
"""
