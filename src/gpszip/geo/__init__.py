"""Planes, gaps, spikes and stops."""
