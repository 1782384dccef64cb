"""Writers of maps and matched routes, one file for each format."""
