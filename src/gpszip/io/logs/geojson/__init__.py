"""GeoJSON: logs as features that are lines or points."""
