"""Empirical-analytical Lagrangian models: potentials learned from samples, and the mechanics built on them."""
