"""The whole job: from a recording to its tracked motion, with a report.

A recording comes in. It goes out tracked, with potentials and the numbers and the text of ``report.json`` and
``report.md``. It touches no file.
"""
