"""Merging of the maps and walks of several archives."""
