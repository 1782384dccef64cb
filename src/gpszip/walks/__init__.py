"""What all packages ask of walks: positions, errors, edge counts and integer grids."""
