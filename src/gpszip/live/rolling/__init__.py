"""Rolling: fixes go from the journal to archives, and leave it once that is proved."""
