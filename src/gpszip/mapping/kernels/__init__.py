"""Compiled loops of map learning."""
