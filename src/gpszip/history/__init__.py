"""What an archive knows of the past: traversals of its edges, and what follows from them."""
