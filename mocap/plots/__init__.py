"""Plots of results for a notebook or a paper, as matplotlib axes.

A recording that was tracked comes in, with its kinematics and cycles. Axes, images and the page ``report.html`` go
out. It touches the folder that it is given.
"""
