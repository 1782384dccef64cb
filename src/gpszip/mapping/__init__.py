"""Maps from segment means and from description length."""
