"""Merging the maps and walks of several archives."""
