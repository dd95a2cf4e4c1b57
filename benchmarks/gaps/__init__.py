"""Filling gaps: our tracker beside what people use, on real recordings with samples hidden where they were measured."""
