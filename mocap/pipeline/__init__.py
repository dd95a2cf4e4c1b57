"""From the files of a recording to its tracked motion, potentials and report."""
