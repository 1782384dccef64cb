"""Compiled loops on arrays and scalars; the only place that imports numba."""
