"""Coding of walks: adaptive models of nodes, edges and times, over a range coder."""
