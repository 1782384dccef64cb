"""KML and KMZ: tracks, points with times, and lines."""
