"""Recordings whose truth is known, made from a seed."""
