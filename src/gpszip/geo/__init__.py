"""Positions on the earth: metric planes, gaps, outliers, sampling and the antimeridian."""
