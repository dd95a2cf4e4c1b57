"""Recordings to marker tracks to relative joint coordinates. SI units and radians inside."""
