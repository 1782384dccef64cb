"""Properties of walks that many packages need: positions, errors, edge counts and integer grids."""
