"""GeoJSON: lines with times, lines without times, and points."""
