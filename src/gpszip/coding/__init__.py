"""Range coder, models and the coding of walks."""
