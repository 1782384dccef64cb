"""How unusual trips are, given earlier ones."""
