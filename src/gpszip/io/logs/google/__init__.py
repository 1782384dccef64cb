"""Location histories of Google, as its services and phones export them."""
