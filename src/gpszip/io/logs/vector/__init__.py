"""Logs in vector formats: rows whose positions are geometries."""
