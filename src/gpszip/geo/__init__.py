"""Metric planes, gaps, outliers and the antimeridian."""
