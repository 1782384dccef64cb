"""Map learning: finds the map that tracks share, by minimum description length."""
