"""Write maps and matched routes, with one module for each format."""
