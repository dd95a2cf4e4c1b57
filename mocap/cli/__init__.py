"""The commands of ``mocap``, one a file: what each takes, and what it says."""
