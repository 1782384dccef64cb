"""Learning the map that tracks share, by description length."""
