"""Coding of walks: modes, models of nodes, paths and times, and the range coder."""
