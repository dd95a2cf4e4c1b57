"""How many frames count as one, where neighbouring ones err alike."""

INDEPENDENT = 0.1
"""Neighbouring frames err alike, lengths too: each counts as so many independent ones. Chosen, not measured."""
FEWEST_FRAMES = round(2 / INDEPENDENT)
"""Two independent ones, which have a variance: of fewer nothing is learned of lengths and directions."""
