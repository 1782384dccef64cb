"""Stays, trips and places of tracks."""
