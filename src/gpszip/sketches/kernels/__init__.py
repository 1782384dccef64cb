"""Compiled loops of coresets."""
