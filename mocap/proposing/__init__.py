"""What a recording shows of the animal: a skeleton and its measures, proposed.

A recording comes in. A skeleton goes out, with its reasons. It touches no file.
"""
