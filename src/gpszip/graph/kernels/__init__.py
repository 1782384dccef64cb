"""Compiled loops of shortest-path search."""
