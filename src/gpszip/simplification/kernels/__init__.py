"""Compiled loops of map simplification."""
