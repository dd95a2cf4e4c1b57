"""Results as files, and as objects for a notebook: ``track``, ``save``, ``load``, tables and exports.

A recording that was tracked comes in, or the folder of one. The folder's files go out, or the recording. It touches
that folder, which is replaced whole or not at all.
"""
