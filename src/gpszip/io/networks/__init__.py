"""Read road networks of any format, and join their lines to a graph."""
