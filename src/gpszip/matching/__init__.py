"""Matching of tracks on a known map."""
