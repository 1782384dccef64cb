"""Readers of road networks, one file for each format."""
