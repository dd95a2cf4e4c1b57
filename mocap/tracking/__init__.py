"""From a cleaned recording to its motion: models, the mixture, one camera, blocks, potentials of joints.

A recording comes in, and a model of other trials where there is one. The recording goes out as it was tracked, with
what was learned of it. It touches model files, and a file of blocks, alone.
"""
