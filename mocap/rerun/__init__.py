"""Recordings, potentials and trusses as rerun shows them.

A recording that was tracked comes in. A ``.rrd`` file, a page with its viewer, or a running viewer goes out. It touches
these files, and a port of 127.0.0.1 while a viewer is open.
"""
