"""The commands of ``mocap``, one in each file: their options and their output."""
